// Tests the page in two browsers: node tests/web/page.mjs [--shots FOLDER], after bindings/web/build target/web/page.
import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import puppeteer from "../../target/web-tools/node_modules/puppeteer-core/lib/esm/puppeteer/puppeteer-core.js";

const shots = process.argv[2] === "--shots" ? process.argv[3] : null;
if (shots) mkdirSync(shots, { recursive: true });
const place = mkdtempSync(join(tmpdir(), "phalanx-web-"));
const BUILT = "target/web/page";
const HANG_MS = 120_000;

// The same engine, which bindings/web/build has built for this machine.
const RUN_HASH = `target/web/${execFileSync("bindings/web/native", { encoding: "utf8" }).trim()}/targets/run-hash`;

/** Returns the results of the same engine. */
function native(path) {
  return execFileSync(RUN_HASH, [path], { encoding: "utf8" }).trim().split(" ").slice(1).join(" ");
}

const shipped = (name) => readFileSync(`scenarios/${name}.toml`, "utf8");

async function opened(browser, { folder = BUILT, query = "", width = 1200, dark = false, first } = {}) {
  const page = await browser.newPage();
  page.asked = [];
  page.on("request", (request) => page.asked.push(request.url()));
  page.on("pageerror", (error) => page.failed ??= error);
  if (first) await page.evaluateOnNewDocument(first);
  await page.setViewport({ width, height: 900 });
  if (dark) await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]).catch(() => {});
  await page.goto(pathToFileURL(join(folder, "index.html")).href + query);
  return page;
}

const ready = (page) => page.waitForSelector("#run:enabled", { timeout: HANG_MS });
const said = (page, id) => page.$eval(`#${id}`, (element) => element.textContent);
const complains = (page) => page.waitForFunction(() => document.querySelector("#wrong").textContent, { timeout: HANG_MS }).then((it) => it.jsonValue());

async function write(page, text) {
  await page.$eval("#text", (element, text) => { element.value = text; }, text);
}

async function digest(page) {
  await page.waitForSelector("#left:not([hidden])", { timeout: HANG_MS });
  return page.$eval("#left", (element) => element.dataset.digest);
}

/** Returns the file that a link of the page offers. */
const offered = (page, name) => page.$eval(`#files a[download="${name}"]`, async (link) => (await fetch(link.href)).text());

async function whole_run(browser) {
  const page = await opened(browser, { query: "?scenario=swap-8" });
  await ready(page);
  // Keyboard: from the text to Run.
  await page.focus("#text");
  await page.keyboard.down("Control");
  await page.keyboard.press("Enter");
  await page.keyboard.up("Control");
  await page.waitForSelector("#stage:not([hidden])");
  await page.focus("#end");
  await page.keyboard.press("Enter");
  assert.equal(await digest(page), native("scenarios/swap-8.toml"));
  console.log(`  8 robots: ${await said(page, "pace")}`);
  assert.match(await said(page, "command"), /^phalanx run scenarios\/swap-8\.toml --pace lockstep$/);
  assert.match(await offered(page, "samples.csv"), /^t_s,robot,x_m/);
  assert.deepEqual(page.asked.filter((url) => !/^(file|blob|data):/.test(url)), [], "the page makes no network request");
  assert.equal(page.failed, undefined);
  await page.close();
}

async function broken_by_hand(browser) {
  const page = await opened(browser, { query: "?scenario=pentagon" });
  await ready(page);
  await page.select("#speed", "20");
  await page.click("#run");
  const press = (row, name) => page.$$eval(`${row} button`, (buttons, name) => buttons.find((it) => it.textContent === name).click(), name);
  const after = (t_s) => page.waitForFunction((t_s) => parseFloat(document.querySelector("#pace").textContent) > t_s, { timeout: HANG_MS }, t_s);
  await after(2);
  await press('.robots tr[data-robot="r2"]', "kill");
  await page.waitForSelector('.robots tr[data-robot="r2"][data-state="dead"]');
  await after(4);
  await press('.robots tr[data-robot="r2"]', "restart");
  await press('.robots tr[data-robot="r3"]', "freeze");
  await after(6);
  await press('.robots tr[data-robot="r3"]', "thaw");
  await press(".edges tbody tr", "cut");
  await page.waitForSelector('.edges tr[data-state="cut"]');
  if (shots) await page.screenshot({ path: join(shots, `by-hand-${browser.name}.png`) });
  await page.click("#end");
  const found = await digest(page);
  const command = await said(page, "command");
  assert.match(command, /--fault 'kill r2 @[\d.]+ restart [\d.]+'/);
  assert.match(command, /--fault 'freeze r3 @[\d.]+ for [\d.]+'/);
  assert.match(command, /--fault 'cut r\d->r\d @[\d.]+'/);
  const path = join(place, "pentagon.toml");
  writeFileSync(path, await offered(page, "scenario.toml"));
  assert.equal(found, native(path), command);
  assert.notEqual(found, native("scenarios/pentagon.toml"));
  await page.close();
}

async function bad_input(browser) {
  const page = await opened(browser);
  await ready(page);
  const mistaken = shipped("pentagon").replace("period_s", "period");
  await write(page, mistaken);
  for (const button of ["#check", "#run"]) {
    await page.click(button);
    const path = join(place, "mistaken.toml");
    writeFileSync(path, mistaken);
    const shown = spawnSync(RUN_HASH, [path], { encoding: "utf8" }).stderr;
    assert.equal(await complains(page), shown.replaceAll(path, "scenarios/pentagon.toml"));
  }
  const file = await page.$("#upload");
  const half = join(place, "half.toml");
  writeFileSync(half, shipped("pentagon").slice(0, 700));
  await file.uploadFile(half);
  await page.waitForFunction(() => document.querySelector("#wrong").textContent.includes("half.toml"));
  assert.match(await complains(page), /^error: /);
  writeFileSync(half, Buffer.from([0x6e, 0xff, 0xfe]));
  await file.uploadFile(half);
  await page.waitForFunction(() => document.querySelector("#wrong").textContent.includes("UTF-8"));
  await write(page, 'law = "nobody"');
  await page.click("#run");
  assert.match(await complains(page), /^error: /);
  await page.close();
  const unknown = await opened(browser, { query: "?scenario=octagon" });
  assert.match(await complains(unknown), /there is no shipped scenario "octagon"/);
  await unknown.close();
  const folder = join(place, "cut-short");
  cpSync(BUILT, folder, { recursive: true });
  const engine = readFileSync(join(folder, "engine.js"), "utf8");
  writeFileSync(join(folder, "engine.js"), engine.slice(0, 20_000) + '";\n');
  const cut = await opened(browser, { folder });
  assert.match(await complains(cut), /engine\.js is incomplete/);
  writeFileSync(join(folder, "engine.js"), engine.slice(0, 20_000));
  await cut.reload();
  assert.match(await complains(cut), /engine\.js is missing next to this page, or incomplete/);
  await cut.close();
}

async function on_a_phone(browser) {
  for (const dark of [false, true]) {
    const page = await opened(browser, { width: 390, dark, query: "?scenario=containment" });
    await ready(page);
    await page.click("#run");
    await page.click("#end");
    await digest(page);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(wide <= 390, `${wide} px`);
    if (shots) await page.screenshot({ path: join(shots, `phone-${browser.name}-${dark ? "dark" : "light"}.png`), fullPage: true });
    await page.close();
  }
}

async function without_webassembly(browser) {
  const page = await opened(browser, { first: () => delete globalThis.WebAssembly });
  assert.match(await complains(page), /^error: This browser has no WebAssembly/);
  await page.close();
}

async function launch(name) {
  const executablePath = name === "chrome" ? "/usr/bin/chromium" : "/usr/bin/firefox-esr";
  const browser = await puppeteer.launch({ browser: name, executablePath, headless: true, args: name === "chrome" ? ["--no-sandbox"] : [], timeout: HANG_MS, protocolTimeout: HANG_MS });
  browser.name = name;
  return browser;
}

try {
  for (const name of ["chrome", "firefox"]) {
    const browser = await launch(name);
    console.log(await browser.version());
    try {
      for (const test of [whole_run, broken_by_hand, bad_input, on_a_phone, without_webassembly]) {
        await test(browser);
        console.log(`  ${test.name}: passed`);
      }
    } finally {
      await browser.close();
    }
  }
} finally {
  rmSync(place, { recursive: true, force: true });
}
