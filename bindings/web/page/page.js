// The page: editing a scenario, running it with the engine, and showing the results. The picture of the run is that of the live
// view (outcome/assets/page.js), which receives frames and events through `globalThis.phalanxFeed`.
//
// An action of the user becomes a fault of the scenario at the current time, and the run is repeated up to that time, which
// takes milliseconds. The results are thus those of the scenario with these faults, and can be reproduced.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const [pick, text, run, check, wrong, stage, left] = ["pick", "text", "run", "check", "wrong", "stage", "left"].map($);
  /** Maximum size of a scenario file, bytes, as in phalanx. */
  const BYTES_MAX = 8 << 20;
  /** Maximum time of uninterrupted computation, ms, so that the page stays responsive. */
  const SLICE_MS = 12;
  let file = "";
  let wasm = null;

  function complain(what) {
    wrong.textContent = what;
    if (what) wrong.scrollIntoView({ block: "nearest" });
  }

  // The engine.

  async function load() {
    if (typeof WebAssembly !== "object") throw "This browser has no WebAssembly, which this page needs to compute the run. All browsers since 2018 have it; some security modes turn it off.";
    if (typeof DecompressionStream !== "function") throw "This browser is too old to unpack the engine, which needs at least Chromium 80, Firefox 113 or Safari 16.4.";
    if (!globalThis.phalanxEngine) throw "engine.js is missing next to this page, or incomplete: get the complete folder again.";
    try {
      const packed = Uint8Array.from(atob(globalThis.phalanxEngine), (letter) => letter.charCodeAt(0));
      const bytes = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
      wasm = await WebAssembly.compile(bytes);
    } catch (error) {
      throw `engine.js is incomplete, or this browser cannot run it: get the complete folder again. (${error})`;
    }
  }

  /** Creates an engine; each run has its own. Returns a function that sends it a request and returns the response. */
  async function engine() {
    const { exports } = await WebAssembly.instantiate(wasm, {});
    const read = (at, bytes) => new TextDecoder().decode(new Uint8Array(exports.memory.buffer, at, bytes));
    return (question) => {
      const bytes = new TextEncoder().encode(JSON.stringify(question));
      try {
        const at = exports.allocate_request(bytes.length);
        new Uint8Array(exports.memory.buffer, at, bytes.length).set(bytes);
        const length = exports.process_request();
        return JSON.parse(read(exports.response(), length));
      } catch (error) {
        const length = exports.panic_message_len();
        return { error: `error: the engine failed: ${length ? read(exports.panic_message(), length) : error}\n` };
      }
    };
  }

  // The scenario.

  function show(name, content) {
    [file, text.value] = [name, content];
    complain("");
    $("report").hidden = true;
  }

  const asked = (faults = []) => ({ file, text: text.value, faults });

  async function checked() {
    const said = (await engine())({ do: "check", ...asked() });
    complain(said.error ?? said.warnings);
    $("report").hidden = !said.report;
    $("report").querySelector("pre").textContent = said.report ?? "";
  }

  async function upload(given) {
    if (!given) return;
    if (given.size > BYTES_MAX) return complain(`error: \`${given.name}\` has ${given.size} bytes\nexpected at most 8 MiB\n`);
    let content;
    try {
      content = new TextDecoder("utf-8", { fatal: true }).decode(await given.arrayBuffer());
    } catch (error) {
      return complain(error instanceof TypeError ? `error: \`${given.name}\` is not UTF-8 text; expected a scenario in TOML\n`
        : `error: \`${given.name}\` could not be read to its end: ${error.message ?? error}\n`);
    }
    show(given.name, content);
    pick.value = "";
    await checked();
  }

  // The run.

  /** The run that is shown; null if there is none. */
  let shown = null;

  class Shown extends EventTarget {
    faults = [];
    tick = 0;
    told = 0;
    owed = 0;
    paused = false;
    over = false;
    began = performance.now();

    async open() {
      this.ask = await engine();
      const opened = this.ask({ do: "open", ...this.asked });
      if (opened.error) return opened.error;
      Object.assign(this, { scenario: opened.scenario, period_s: opened.period_s, name: opened.name, duration_s: opened.duration_s });
      this.html ??= opened.html;
      return "";
    }

    /** Advances the run by some ticks, and updates the picture. */
    advance(ticks) {
      const said = this.ask({ do: "advance", ticks, told: this.told });
      if (said.error) throw said.error;
      Object.assign(this, { tick: said.tick, over: said.over, frame: said.frame });
      this.told += said.happened.length;
      for (const event of said.happened) this.tell("happened", event);
    }

    tell(type, data) {
      this.dispatchEvent(new MessageEvent(type, { data: JSON.stringify(data) }));
    }

    get t_s() {
      return this.frame?.t_s ?? 0;
    }

    /** Adds a fault for an action of the user, from the current time on. */
    async act({ act, robot, from, to }) {
      if (this.over) return new Response("the run is over", { status: 409 });
      const now = +this.t_s.toFixed(9);
      const before = this.asked;
      const faults = [...this.faults];
      const link = `${from}->${to}`;
      const lasted = (what) => faults.findLast((fault) => fault.what === what && fault.until === undefined);
      const end = { restart: ["kill", " restart "], thaw: ["freeze", " for "], mend: ["cut", " for "] }[act];
      if (end) {
        const what = `${end[0]} ${act === "mend" ? link : robot}`;
        const fault = lasted(what);
        if (!fault) return new Response("this fault is part of the scenario: change it there", { status: 409 });
        const for_s = +(now - fault.at).toFixed(9) || this.period_s;
        faults[faults.indexOf(fault)] = { ...fault, until: end[1] + for_s };
      } else faults.push({ what: act === "cut" ? `cut ${link}` : `${act} ${robot}`, at: now });
      this.asked = { ...before, faults: faults.map(({ what, at, until = "" }) => `${what} @${at}${until}`) };
      const [ask, tick] = [this.ask, this.tick];
      this.busy = true;
      const refused = await this.open();
      if (refused) {
        [this.ask, this.asked] = [ask, before];
        this.busy = false;
        return new Response(refused.split("\n")[0], { status: 409 });
      }
      this.faults = faults;
      this.advance(tick);
      this.busy = false;
      return new Response("");
    }
  }

  async function begin() {
    complain("");
    left.hidden = true;
    const next = new Shown();
    next.asked = asked();
    const refused = await next.open();
    if (refused) return complain(refused);
    if (shown) shown.over = true;
    shown = next;
    globalThis.phalanxFeed = {
      listen() {
        next.heard = true;
        return next;
      },
      act: (body) => next.act(body),
    };
    stage.hidden = false;
    $("name").textContent = next.name;
    const picture = $("picture");
    picture.innerHTML = next.html;
    const script = document.createElement("script");
    script.type = "module";
    script.textContent = globalThis.phalanxPicture;
    picture.append(script);
    pause(false);
    stage.scrollIntoView({ block: "start" });
    next.file = file;
    next.edited = globalThis.phalanxScenarios[pick.value] !== next.asked.text;
    next.last = undefined;
    next.advance(0);
    requestAnimationFrame((now) => turn(next, now));
  }

  function pause(paused) {
    shown.paused = paused;
    $("pause").textContent = paused ? "Continue" : "Pause";
  }

  /** Advances the run at the selected speed, or as fast as the browser can. */
  function turn(it, now) {
    if (it !== shown || it.left) return;
    const speed = +$("speed").value;
    const passed_s = Math.min(0.1, (now - (it.last ?? now)) / 1000);
    it.last = now;
    if (it.heard && !it.paused && !it.busy) {
      it.owed = speed >= 1000 ? Infinity : it.owed + (passed_s * speed) / it.period_s;
      const start = performance.now();
      const from_s = it.t_s;
      try {
        while (it.owed >= 1 && !it.over && performance.now() - start < SLICE_MS) {
          const ticks = Math.min(Math.floor(it.owed), 8);
          it.advance(ticks);
          it.owed -= ticks;
        }
      } catch (error) {
        it.left = true;
        return complain(String(error));
      }
      it.owed = Math.min(it.owed, speed / it.period_s / 10);
      it.tell("message", it.frame);
      if (it.over) return leave(it);
      if (passed_s) it.rate = 0.9 * (it.rate ?? (it.t_s - from_s) / passed_s) + (0.1 * (it.t_s - from_s)) / passed_s;
      $("pace").textContent = `${it.t_s.toFixed(2)} s of ${it.duration_s} s, ${(it.rate ?? 0).toFixed(it.rate < 9.5 ? 1 : 0)} times real time`;
    }
    requestAnimationFrame((now) => turn(it, now));
  }

  async function toTheEnd() {
    const it = shown;
    if (!it || it.left) return;
    pause(true);
    const start = [performance.now(), it.t_s];
    while (!it.over) {
      const slice = performance.now();
      while (!it.over && performance.now() - slice < 100) it.advance(50);
      const rate = ((it.t_s - start[1]) * 1000) / (performance.now() - start[0]);
      $("pace").textContent = `${it.t_s.toFixed(2)} s of ${it.duration_s} s, ${rate.toFixed(0)} times real time`;
      it.tell("message", it.frame);
      await new Promise((resolve) => setTimeout(resolve));
      if (it !== shown || it.left) return;
    }
    leave(it);
  }

  function leave(it) {
    if (it.left) return;
    it.left = true;
    const said = it.ask({ do: "left" });
    if (said.error) return complain(said.error);
    it.tell("ended", { exit: said.exit, text: "" });
    left.hidden = false;
    $("hash").textContent = said.hash;
    left.dataset.digest = said.digest;
    $("screen").textContent = said.screen;
    const words = it.edited ? `# scenario.toml is below, with your changes and faults\nphalanx run scenario.toml --pace lockstep`
      : [`phalanx run ${it.file} --pace lockstep`, ...it.asked.faults.map((fault) => `--fault '${fault}'`)].join(" \\\n    ");
    $("command").textContent = words;
    const files = $("files");
    files.replaceChildren();
    for (const [name, content] of [...Object.entries(said.files), ["scenario.toml", it.scenario]]) {
      const link = document.createElement("a");
      link.download = name;
      link.href = URL.createObjectURL(new Blob([content], { type: "text/plain" }));
      link.textContent = name;
      files.append(link);
    }
  }

  // The page.

  const names = Object.keys(globalThis.phalanxScenarios);
  for (const name of names) pick.append(new Option(name, name));
  const take = (name) => {
    if (!(name in globalThis.phalanxScenarios)) {
      return complain(`error: there is no shipped scenario "${name}"; there are ${names.join(", ")}\n`);
    }
    pick.value = name;
    show(`scenarios/${name}.toml`, globalThis.phalanxScenarios[name]);
  };
  take("pentagon");
  const wanted = new URLSearchParams(location.search).get("scenario") ?? location.hash.slice(1);
  if (wanted) take(wanted);
  pick.addEventListener("change", () => take(pick.value));
  $("reset").addEventListener("click", () => take(pick.value || "pentagon"));
  $("upload").addEventListener("change", async ({ target }) => {
    await upload(target.files[0]);
    // Selecting the same file again loads it again.
    target.value = "";
  });
  const guarded = (act) => async () => {
    try {
      await act();
    } catch (error) {
      complain(String(error));
    }
  };
  run.addEventListener("click", guarded(begin));
  check.addEventListener("click", guarded(checked));
  text.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !(event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    if (!run.disabled) run.click();
  });
  $("pause").addEventListener("click", () => shown && !shown.left && pause(!shown.paused));
  $("end").addEventListener("click", guarded(toTheEnd));
  load().then(() => {
    run.disabled = check.disabled = false;
  }, (why) => complain(`error: ${why}\n`));
})();
