// Plane picture of a run, replayed from a report or live while the run is in progress.
//
// Both show the same frames (outcome/src/report/scene.rs); a missing number is null. Text of a scenario reaches
// the page as text, never as markup. The live page listens to `events` and posts to `control`, and sends no
// other requests. If the page itself computes the run, `phalanxFeed` replaces both.
const TRAIL_S = 5;
const still = matchMedia("(prefers-reduced-motion: reduce)");

// Decoding of the frames that outcome/src/report/page/pack.rs encodes.

function unpack({ count, data, per_m, error_per_m }, scene) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  let at = 0;
  const number = () => {
    let value = 0;
    for (let unit = 1; ; unit *= 128) {
      const byte = bytes[at++];
      value += (byte & 127) * unit;
      if (byte < 128) return value;
    }
  };
  const column = (perUnit) => {
    let last = 0;
    return Array.from({ length: count }, () => {
      const code = number() - 1;
      if (code < 0) return null;
      last += code % 2 ? -(code + 1) / 2 : code / 2;
      return last / perUnit;
    });
  };
  const runs = (names) => {
    const states = [];
    while (states.length < count) {
      const state = names[number()];
      for (let left = number(); left > 0; left--) states.push(state);
    }
    return states;
  };
  const time = column(1e3);
  const distance = column(1e6);
  const robots = scene.robots.map(() => [column(per_m), column(per_m), column(1e3), column(error_per_m)]);
  const states = scene.robots.map(() => runs(["moving", "frozen", "dead", "starting", "orphaned"]));
  const edges = scene.edges.map(() => runs(["fresh", "stale", "lost", "cut", "dead", "closed"]));
  return time.map((t_s, i) => ({
    t_s: t_s ?? 0,
    distance_m: distance[i],
    robots: robots.map(([x, y, heading, error], robot) => ({
      x_m: x[i], y_m: y[i], heading_rad: heading[i], error_m: error[i], state: states[robot][i],
    })),
    edges: edges.map((edge) => edge[i]),
  }));
}

/** The frame at a time between two frames; states and distance are those of the first. */
function between(a, b, t_s) {
  const share = (t_s - a.t_s) / (b.t_s - a.t_s);
  if (!(share > 0)) return a;
  const mix = (p, q) => p + share * (q - p);
  const robots = a.robots.map((p, i) => {
    const q = b.robots[i];
    if (!placed(p) || !placed(q)) return p;
    const turn = q.heading_rad - p.heading_rad;
    const heading_rad = p.heading_rad + share * Math.atan2(Math.sin(turn), Math.cos(turn));
    return { ...p, x_m: mix(p.x_m, q.x_m), y_m: mix(p.y_m, q.y_m), heading_rad };
  });
  return { ...a, t_s, robots };
}

// The plane.

const placed = (robot) => robot.x_m !== null && robot.y_m !== null && robot.heading_rad !== null;

/** Front points [x, y], m, in scenario order; null for a robot without a position. */
function fronts(scene, frame) {
  return frame.robots.map((robot, i) => {
    if (!placed(robot)) return null;
    const ahead_m = scene.robots[i].front_point_m ?? 0;
    return [robot.x_m + ahead_m * Math.cos(robot.heading_rad), robot.y_m + ahead_m * Math.sin(robot.heading_rad)];
  });
}

function outline(wall, project, scale) {
  if (wall.corners_m) return line(wall.corners_m.map(project)) + "Z";
  const r = wall.radius_m * scale;
  const [x, y] = project(wall.center_m);
  return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
}

function bounds(points) {
  const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

/** Counter-clockwise corners of the convex hull (monotone chain). */
function hull(points) {
  const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const chain = (points) => {
    const corners = [];
    for (const p of points) {
      for (;;) {
        const [a, b] = corners.slice(-2);
        if (!b || (b[0] - a[0]) * (p[1] - a[1]) > (b[1] - a[1]) * (p[0] - a[0])) break;
        corners.pop();
      }
      corners.push(p);
    }
    return corners.slice(0, -1);
  };
  return sorted.length < 2 ? sorted : [...chain(sorted), ...chain(sorted.reverse())];
}

/** 1, 2 or 5 times a power of ten, at least this. */
function roundUp(minimum) {
  const power = 10 ** Math.floor(Math.log10(minimum));
  return [1, 2, 5, 10].map((times) => times * power).find((step) => step >= minimum * 0.999);
}

/** Labels of a grid that is far from 0 are relative to this round number; 0 where they need none. See outcome/src/report/axis.rs. */
function offset(low, high, step) {
  if (Math.max(Math.abs(low), Math.abs(high)) / step <= 1e4) return 0;
  const round = 10 ** Math.ceil(Math.log10(high - low));
  return Math.round((low + high) / 2 / round) * round;
}

/** Returns the caption of an axis whose labels are relative to an offset: "x \u2212 500000 m". */
function axisLabel(axis, offset, span) {
  const digits = Math.max(0, -Math.ceil(Math.log10(span)));
  return `${axis} ${offset < 0 ? "+" : "\u2212"} ${Math.abs(offset).toFixed(digits)} m`;
}

// The document.

function svg(parent, tag, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  parent.append(element);
  return element;
}

function html(parent, tag, className = "", text = "") {
  const element = document.createElement(tag);
  element.className = className;
  element.textContent = text;
  parent.append(element);
  return element;
}

function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

const meters = (value, digits) => (value == null ? "-" : value.toFixed(digits));
const seconds = (value) => `${value.toFixed(2)} s`;
const px = (value) => Math.round(value * 10) / 10;
const line = (points) => "M" + points.map(([x, y]) => `${px(x)} ${px(y)}`).join("L");

/** Number of robot colors; see outcome/src/report/palette.rs. */
const COLORS = 9;

/** Returns the CSS classes of each robot, in scenario order: the role determines its shape, the index its color. */
const robotClasses = (scene) => scene.robots.map(({ role }, i) => `${role} c${i % COLORS}`);

/** Robots, edges and hull in the plane, and the list of robots next to it. */
class Picture {
  constructor(root, scene) {
    const find = (selector) => root.querySelector(selector);
    Object.assign(this, { root, scene, plane: find(".plane"), mode: "fit", all: null, span: [0, 0], view: [0, 0, 100] });
    this.canvas = find(".plane svg");
    // Decimals of lengths in m: 0.1 mm, or a hundredth of d if that is less.
    this.digits = Math.max(4, Math.min(9, 2 - Math.floor(Math.log10(scene.distance_min_m || 1))));
    this.contained = scene.robots.some((robot) => robot.role === "contained");
    this.paired = scene.edges.map((edge) => scene.edges.some((other) => other.from === edge.to && other.to === edge.from));
    this.fields = { time: find(".time"), distance: find(".distance"), now: find(".now"), fault: find(".fault"), selected: find("p.selected") };
    this.build();
    this.tools();
    this.pointers();
    new ResizeObserver(() => this.draw()).observe(this.plane);
  }

  build() {
    const { scene, canvas, root } = this;
    this.grid = svg(canvas, "g", { class: "grid" });
    this.walls = svg(canvas, "path", { class: "wall" });
    this.area = svg(canvas, "path", { class: "hull" });
    const classes = robotClasses(scene);
    this.trails = classes.map((names) => svg(canvas, "path", { class: `trail ${names}` }));
    this.arrows = scene.edges.map(({ spare }) => {
      const group = svg(canvas, "g", { class: spare ? "edge spare" : "edge" });
      return { group, line: svg(group, "path", { class: "line" }), head: svg(group, "path", { class: "head" }), cut: svg(group, "path", { class: "cut" }) };
    });
    const rows = root.querySelector(".robots tbody");
    this.robots = scene.robots.map((robot, i) => {
      const group = svg(canvas, "g", { class: `robot ${classes[i]}` });
      group.dataset.robot = robot.name;
      const title = svg(group, "title");
      const reach = svg(group, "circle", { class: "reach" });
      const body = svg(group, "path", { class: "body", d: "M0 0L-1.7 .75L-1.25 0L-1.7 -.75Z" });
      svg(group, "circle", { class: "front", r: 1.8 });
      if (robot.role === "main-leader") svg(group, "circle", { class: "crown", r: 2.5 });
      const mark = svg(group, "path", { class: "mark" });
      const row = html(rows, "tr");
      row.dataset.robot = robot.name;
      const head = html(row, "th");
      head.scope = "row";
      const pick = html(head, "button", "pick");
      pick.type = "button";
      pick.title = `${robot.name}, ${robot.role}`;
      pick.setAttribute("aria-pressed", "false");
      pick.addEventListener("click", () => this.select(i));
      html(pick, "i", `swatch ${classes[i]}`);
      html(pick, "span", "", robot.name);
      const cells = [html(row, "td", "state"), html(row, "td", "error")];
      return { group, title, reach, body, mark, row, pick, cells };
    });
    // Above all robots and arrows.
    this.names = scene.robots.map((robot) => {
      const name = svg(canvas, "text", { class: "name" });
      name.textContent = robot.name;
      return name;
    });
    const several = scene.robots.length > COLORS ? `: after ${COLORS} robots they repeat` : " of its own";
    setText(root.querySelector(".legend .colors"), `each robot has a color${several}, as in the list and in all figures`);
    for (const item of root.querySelectorAll(".legend [data-role]")) {
      item.hidden = !scene.robots.some((robot) => robot.role === item.dataset.role);
    }
    for (const item of root.querySelectorAll(".legend [data-need]")) {
      item.hidden = !(item.dataset.need === "hull" ? this.contained : item.dataset.need === "spares" ? scene.edges.some(({ spare }) => spare) : scene[item.dataset.need]?.length);
    }
    this.sizes = scene.robots.some((robot) => robot.keep_m);
    setText(root.querySelector(".legend .circle"), this.sizes
      ? "circle of radius keep_m around the front point: while no two circles overlap, every two robots keep their minimum distance"
      : "circle of radius d / 2 around the front point: while no two circles overlap, " +
        `no two robots are nearer to each other than d = ${scene.distance_min_m} m`);
    root.querySelector(".legend").open = root.clientWidth > 600;
  }

  tools() {
    for (const button of this.root.querySelectorAll("[data-view]")) {
      const act = button.dataset.view;
      button.addEventListener("click", () => {
        if (act === "in" || act === "out") this.zoom(act === "in" ? 1.5 : 1 / 1.5);
        else this.aim(act);
      });
    }
    for (const box of this.root.querySelectorAll("[data-layer]")) {
      if (box.dataset.layer === "names" && this.scene.robots.length > 24) box.checked = false;
      const apply = () => {
        this.root.classList.toggle(`no-${box.dataset.layer}`, !box.checked);
        this.draw();
      };
      box.addEventListener("change", apply);
      apply();
    }
    this.plane.addEventListener("keydown", (event) => {
      const shift = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
      if (!event.shiftKey || !shift) return;
      event.preventDefault();
      this.pan(...shift);
    });
  }

  pointers() {
    const held = new Map();
    let moved = 0;
    const { plane } = this;
    plane.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      if (!held.size) moved = 0;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      plane.setPointerCapture(event.pointerId);
    });
    plane.addEventListener("pointermove", (event) => {
      const last = held.get(event.pointerId);
      if (!last) return;
      const position = [event.clientX, event.clientY];
      const [dx, dy] = [position[0] - last[0], position[1] - last[1]];
      held.set(event.pointerId, position);
      moved += Math.hypot(dx, dy);
      const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const distance = (point) => Math.max(20, Math.hypot(point[0] - other[0], point[1] - other[1]));
        this.pan(dx / 2, dy / 2);
        this.zoom(distance(position) / distance(last), (position[0] + other[0]) / 2, (position[1] + other[1]) / 2);
      } else if (event.pointerType !== "touch" && moved > 4) {
        plane.classList.add("moving");
        this.pan(dx, dy);
      }
    });
    const release = (event) => {
      if (!held.delete(event.pointerId)) return;
      plane.classList.remove("moving");
      if (event.type === "pointerup" && moved <= 4) this.pickAt(event.clientX, event.clientY);
    };
    plane.addEventListener("pointerup", release);
    plane.addEventListener("pointercancel", release);
    plane.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-Math.max(-60, Math.min(60, event.deltaY)) / 200), event.clientX, event.clientY);
    }, { passive: false });
  }

  // View: center x, y in m and scale in px / m.

  aim(mode) {
    this.mode = mode;
    for (const button of this.root.querySelectorAll("[data-view][aria-pressed]")) {
      button.setAttribute("aria-pressed", String(button.dataset.view === mode));
    }
    this.draw();
  }

  pan(dx, dy) {
    this.view[0] -= dx / this.view[2];
    this.view[1] += dy / this.view[2];
    this.aim("free");
  }

  zoom(times, clientX, clientY) {
    const box = this.plane.getBoundingClientRect();
    const right = clientX === undefined ? 0 : clientX - box.left - box.width / 2;
    const down = clientY === undefined ? 0 : clientY - box.top - box.height / 2;
    const scale = Math.max(1e-6, Math.min(1e8, this.view[2] * times));
    const shift = 1 / this.view[2] - 1 / scale;
    this.view = [this.view[0] + right * shift, this.view[1] - down * shift, scale];
    this.aim("free");
  }

  camera(points, width, height) {
    if (this.mode === "free" || !this.all) return;
    const d = this.scene.distance_min_m || 0.05;
    const room = 2 * d;
    let box = this.all;
    let size = [box[2] - box[0], box[3] - box[1]];
    if (this.mode === "follow") {
      const alive = points.filter((point, i) => point && this.frame.robots[i].state !== "dead");
      if (!alive.length) return;
      box = bounds(alive);
      size = this.span;
    }
    const scale = Math.min((width - 60) / (size[0] + room), (height - 60) / (size[1] + room));
    // If the robots would be too small in a view of the whole run, the view follows them.
    const small = !this.aimed && (scale * d) / 2 < 6 && this.mode === "fit";
    this.aimed = true;
    if (small) return this.aim("follow");
    this.view = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, Math.max(scale, 1e-6)];
  }

  /** Extends the shown area to a frame. `slack`: additional margin for later frames, as a fraction. */
  include(frame, slack = 0) {
    const points = fronts(this.scene, frame).filter(Boolean);
    if (!points.length) return;
    const box = bounds(points);
    this.span = [Math.max(this.span[0], box[2] - box[0]), Math.max(this.span[1], box[3] - box[1])];
    const all = (this.all ??= box);
    const margin = slack * Math.max(all[2] - all[0], all[3] - all[1]);
    this.all = all.map((side, i) => {
      if (i < 2) return box[i] < side ? box[i] - margin : side;
      return box[i] > side ? box[i] + margin : side;
    });
  }

  select(i) {
    this.chosen = this.chosen === i ? undefined : i;
    this.robots.forEach(({ group, row, pick }, index) => {
      const chosen = index === this.chosen;
      group.classList.toggle("selected", chosen);
      row.classList.toggle("selected", chosen);
      pick.setAttribute("aria-pressed", String(chosen));
    });
    this.arrows.forEach(({ group }, index) => group.classList.toggle("heard", this.scene.edges[index].to === this.chosen));
    this.draw();
  }

  pickAt(clientX, clientY) {
    const box = this.plane.getBoundingClientRect();
    const distances = this.points.map((p) => (p ? Math.hypot(p[0] - clientX + box.left, p[1] - clientY + box.top) : Infinity));
    const nearest = distances.indexOf(Math.min(...distances));
    if (distances[nearest] > Math.max(16, this.radius)) return;
    this.select(nearest);
    const { row } = this.robots[nearest];
    const rows = row.closest(".rows");
    rows.scrollTop = row.offsetTop - rows.clientHeight / 2;
  }

  // Drawing.

  /** Shows a frame, with the trail of frames before it. */
  show(frame, past = []) {
    this.frame = frame;
    this.past = past;
    this.draw();
  }

  draw() {
    const { frame, scene } = this;
    const [width, height] = [this.plane.clientWidth, this.plane.clientHeight];
    if (!frame || !width) return;
    const points = fronts(scene, frame);
    this.camera(points, width, height);
    const [cx, cy, scale] = this.view;
    const project = (p) => p && [width / 2 + (p[0] - cx) * scale, height / 2 - (p[1] - cy) * scale];
    this.points = points.map(project);
    this.radius = ((scene.distance_min_m || 0) / 2) * scale;
    this.drawGrid(width, height);
    this.walls.setAttribute("d", (scene.walls ?? []).map((w) => outline(w, project, scale)).join(""));
    const leaders = this.points.filter((p, i) => p && scene.robots[i].role.endsWith("leader"));
    this.area.setAttribute("d", this.contained && leaders.length > 1 ? line(hull(leaders)) + "Z" : "");
    this.drawTrails(project);
    this.drawEdges();
    this.drawRobots(points);
    this.readout();
  }

  drawGrid(width, height) {
    const [cx, cy, scale] = this.view;
    const key = [cx, cy, scale, width, height].join();
    if (key === this.gridKey) return;
    this.gridKey = key;
    this.grid.replaceChildren();
    const step = roundUp(75 / scale);
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    const [lines, axes] = [svg(this.grid, "path"), svg(this.grid, "path", { class: "axes" })];
    const paths = ["", ""];
    const text = (label_text, x, y, anchor = "start") => {
      svg(this.grid, "text", { x, y, "text-anchor": anchor }).textContent = label_text;
    };
    const [left, right, low, high] = [cx - width / 2 / scale, cx + width / 2 / scale, cy - height / 2 / scale, cy + height / 2 / scale];
    const [x0, y0] = [offset(left, right, step), offset(low, high, step)];
    const label = (value) => `${(value + 0).toFixed(digits)} m`;
    for (let i = Math.ceil(left / step); i * step < right; i++) {
      const x = px((i * step - left) * scale);
      paths[i ? 0 : 1] += `M${x} 0V${height}`;
      if (x > 50 && x < width - (x0 ? 150 : 45)) text(label(i * step - x0), x + 3, height - 5);
    }
    for (let i = Math.ceil(low / step); i * step < high; i++) {
      const y = px((high - i * step) * scale);
      paths[i ? 0 : 1] += `M0 ${y}H${width}`;
      if (y > (y0 ? 34 : 14) && y < height - 20) text(label(i * step - y0), 4, y - 3);
    }
    if (x0) text(axisLabel("x", x0, right - left), width - 4, height - 5, "end");
    if (y0) text(axisLabel("y", y0, high - low), 4, 14);
    lines.setAttribute("d", paths[0]);
    axes.setAttribute("d", paths[1]);
  }

  drawTrails(project) {
    if (this.root.classList.contains("no-trails")) return;
    const past = [...this.past.map((frame) => fronts(this.scene, frame)), fronts(this.scene, this.frame)];
    this.trails.forEach((trail, i) => {
      const points = past.map((points) => project(points[i])).filter(Boolean);
      trail.setAttribute("d", points.length > 1 ? line(points) : "");
    });
  }

  drawEdges() {
    if (this.root.classList.contains("no-edges")) return;
    this.arrows.forEach(({ group, line: shaft, head, cut }, i) => {
      const { from, to } = this.scene.edges[i];
      const [p, q] = [this.points[from], this.points[to]];
      const length = p && q ? Math.hypot(q[0] - p[0], q[1] - p[1]) : 0;
      group.dataset.state = this.frame.edges[i] ?? "fresh";
      const visible = length > 4 && group.dataset.state !== "closed";
      group.style.visibility = visible ? "" : "hidden";
      if (!visible) return;
      const [ux, uy] = [(q[0] - p[0]) / length, (q[1] - p[1]) / length];
      const shift = this.paired[i] ? 3 : 0;
      const room = Math.min(Math.max(this.radius, 5), length * 0.3);
      const pointAt = (along, side) => [p[0] + ux * along + uy * (side + shift), p[1] + uy * along - ux * (side + shift)];
      const size = Math.min(8, length / 4);
      const tip = length - room;
      shaft.setAttribute("d", line([pointAt(room, 0), pointAt(tip - size, 0)]));
      head.setAttribute("d", line([pointAt(tip, 0), pointAt(tip - size, size / 2), pointAt(tip - size, -size / 2)]) + "Z");
      const middle = (room + tip - size) / 2;
      cut.setAttribute("d", line([pointAt(middle - 4, 5), pointAt(middle, -5)]) + line([pointAt(middle, 5), pointAt(middle + 4, -5)]));
    });
  }

  drawRobots(points) {
    const { scene, frame } = this;
    const d = scene.distance_min_m;
    const near = new Set();
    // The frame has the distance to the micrometer, the positions only to millimeters.
    if (frame.distance_m !== null && frame.distance_m < d - 1e-6) {
      const minimum = (i, j) => (this.sizes ? scene.robots[i].keep_m + scene.robots[j].keep_m - 4e-3 : d);
      points.forEach((p, i) => points.forEach((q, j) => {
        if (i < j && p && q && Math.hypot(p[0] - q[0], p[1] - q[1]) < minimum(i, j) + 2e-3) near.add(i).add(j);
      }));
    }
    this.robots.forEach((parts, i) => {
      const { group, reach, body, mark, title } = parts;
      const name = this.names[i];
      const [p, robot] = [this.points[i], frame.robots[i]];
      group.style.visibility = name.style.visibility = p ? "" : "hidden";
      if (!p) return;
      group.setAttribute("transform", `translate(${px(p[0])} ${px(p[1])})`);
      reach.setAttribute("r", px(scene.robots[i].keep_m ? scene.robots[i].keep_m * this.view[2] : this.radius));
      const size = Math.max(7, (scene.robots[i].front_point_m ?? 0) * this.view[2]);
      body.setAttribute("transform", `rotate(${px((-robot.heading_rad * 180) / Math.PI)}) scale(${px(size)})`);
      name.setAttribute("x", px(p[0]));
      name.setAttribute("y", px(p[1] - Math.max(this.radius, 8) - 5));
      group.classList.toggle("near", near.has(i));
      const arm = Math.max(7, Math.min(16, this.radius * 0.7));
      const wing = arm / 2;
      const rise = arm * 0.87;
      const marks = {
        orphaned: `M${-wing / 2} ${-wing}A${wing / 2} ${wing / 2} 0 1 1 0 0V${wing / 2}M0 ${wing}V${wing + 1}`,
        dead: `M${-rise} ${-rise}L${rise} ${rise}M${-rise} ${rise}L${rise} ${-rise}`,
        frozen: `M0 ${-arm}V${arm}M${-rise} ${-wing}L${rise} ${wing}M${-rise} ${wing}L${rise} ${-wing}`,
      };
      mark.setAttribute("d", marks[robot.state] ?? "");
      if (group.dataset.state !== robot.state) {
        group.dataset.state = name.dataset.state = robot.state;
        setText(title, `${scene.robots[i].name}, ${scene.robots[i].role}, ${robot.state}`);
      }
    });
  }

  readout() {
    const { frame, scene, fields } = this;
    const end = Number.isFinite(scene.duration_s) ? ` of ${scene.duration_s} s` : "";
    setText(fields.time, seconds(frame.t_s) + end);
    const d = scene.distance_min_m;
    const bound = this.sizes ? "" : ` (d = ${d} m)`;
    setText(fields.distance, frame.distance_m == null ? "-" : `${meters(frame.distance_m, this.digits)} m${bound}`);
    fields.distance.classList.toggle("under", !this.sizes && frame.distance_m != null && frame.distance_m < d - 1e-6);
    const active = scene.faults.filter((fault) => fault.t_s <= frame.t_s && frame.t_s < (fault.until_s ?? Infinity));
    setText(fields.fault, active.map((fault) => fault.what).join(", "));
    fields.now.classList.toggle("on", active.length > 0);
    // States are updated at once, numbers only as fast as they can be read.
    const numbers = !(performance.now() - this.readAt < 150) || this.exact;
    if (numbers) this.readAt = performance.now();
    this.robots.forEach(({ row, cells }, i) => {
      const robot = frame.robots[i];
      if (row.dataset.state !== robot.state) {
        row.dataset.state = robot.state;
        setText(cells[0], robot.state);
        this.changed?.(i, robot.state);
      }
      if (numbers) setText(cells[1], meters(robot.error_m, this.digits));
    });
    if (!numbers) return;
    const robot = frame.robots[this.chosen];
    const name = scene.robots[this.chosen]?.name;
    setText(fields.selected, !robot || !placed(robot) ? "" :
      `${name}: x ${meters(robot.x_m, this.digits - 1)} m, y ${meters(robot.y_m, this.digits - 1)} m, heading ${robot.heading_rad.toFixed(3)} rad`);
    this.canvas.setAttribute("aria-label", `${scene.robots.length} robots in the plane; the list gives their states and errors`);
  }
}

/** Time line from 0 to the end: smallest distance, faults, and current position. */
class Track {
  constructor(root, scene, end_s) {
    Object.assign(this, { track: root.querySelector(".track"), scene, end_s: Math.max(end_s, 1e-3), path: "", bin: -1, minimum: null });
    this.top = 4 * (scene.distance_min_m || 1);
    const spark = root.querySelector(".spark");
    // Pairs of a team have different minimum distances, so that no line is a bound for all.
    const team = scene.robots.some((robot) => robot.keep_m);
    if (!team) svg(spark, "path", { class: "bound", d: `M0 ${this.height(scene.distance_min_m)}H1000` });
    this.spark = svg(spark, "path");
    const { faults, faults_in_all } = scene;
    const left_out = faults_in_all > faults.length ? `; the first ${faults.length} of ${faults_in_all} faults are marked` : "";
    setText(root.querySelector(".scale"), `smallest distance over time, 0 to ${+this.top.toPrecision(3)} m${team ? "" : "; dashed: d"}${left_out}`);
    this.marks = root.querySelector(".marks");
    this.lanes = [];
    this.marks.style.height = "0px";
  }

  height(distance_m) {
    return px(100 - 96 * Math.min(1, distance_m / this.top));
  }

  /** Adds a frame to the line of smallest distances, which shows the minimum of each of 1000 bins. */
  add(frame) {
    const bin = Math.floor((frame.t_s / this.end_s) * 1000);
    if (bin !== this.bin) this.flush();
    this.bin = bin;
    if (frame.distance_m != null) this.minimum = Math.min(this.minimum ?? Infinity, frame.distance_m);
  }

  flush() {
    if (this.minimum !== null) this.path += `${this.path ? "L" : "M"}${this.bin} ${this.height(this.minimum)}`;
    this.minimum = null;
    this.spark.setAttribute("d", this.path);
  }

  /** Draws a fault in the first lane with space, in place of an old mark. `until_s`: its end; null if it lasts, undefined if it is over at once. */
  mark(t_s, until_s, what, go, old) {
    old?.remove();
    this.lanes = this.lanes.map((lane) => lane.filter(([, , mark]) => mark !== old));
    const share = (t_s) => Math.max(0, Math.min(1, t_s / this.end_s));
    const [from, to] = [share(t_s), share(until_s === undefined ? t_s : (until_s ?? this.end_s))];
    // A fault too short for its label has the label next to it.
    const wide = (what.length * 6.2 + 16) / (this.marks.clientWidth || 600);
    const short = to - from < wide;
    const late = short && to + wide > 1;
    const [left, right] = [late ? from - wide : from, short && !late ? to + wide : Math.max(to, from + 0.012)];
    const room = this.lanes.findIndex((lane) => lane.every(([a, b]) => right <= a || b <= left));
    const lane = room < 0 && this.lanes.length < 4 ? this.lanes.push([]) - 1 : Math.max(0, room);
    const mark = html(this.marks, go ? "button" : "div", `${until_s === undefined ? "done" : ""}${short ? " short" : ""}${late ? " late" : ""}`);
    this.lanes[lane].push([left, right, mark]);
    html(mark, "span", "", what);
    mark.style.cssText = `left:${from * 100}%;top:${lane * 18}px;width:${(to - from) * 100}%`;
    const when = until_s === undefined ? `at ${seconds(t_s)}` : until_s === null ? `from ${seconds(t_s)} on` : `${seconds(t_s)} to ${seconds(until_s)}`;
    mark.title = `${what}, ${when}`;
    mark.setAttribute("aria-label", mark.title);
    this.marks.style.height = `${this.lanes.length * 18}px`;
    if (!go) return mark;
    mark.type = "button";
    mark.addEventListener("click", () => go(t_s));
    return mark;
  }

  move(t_s) {
    this.track.style.setProperty("--at", Math.max(0, Math.min(1, t_s / this.end_s)));
  }
}

function replay(root, scene, picture) {
  const frames = unpack(JSON.parse(root.querySelector(".frames").textContent), scene);
  const [play, scrub, speed] = [".play", ".scrub", ".speed"].map((selector) => root.querySelector(selector));
  const end_s = frames.length ? frames.at(-1).t_s : 0;
  let [now_s, at, playing, last] = [0, 0, false, 0];
  const track = new Track(root, scene, end_s);
  for (const frame of frames) {
    picture.include(frame);
    track.add(frame);
  }
  track.flush();
  for (const fault of scene.faults) track.mark(fault.t_s, fault.until_s, fault.what, (t_s) => seek(t_s));
  scrub.max = end_s;
  if (!frames.length) {
    play.disabled = scrub.disabled = true;
    return;
  }

  function seek(t_s) {
    now_s = Math.max(0, Math.min(end_s, t_s));
    while (at + 1 < frames.length && frames[at + 1].t_s <= now_s) at++;
    while (at > 0 && frames[at].t_s > now_s) at--;
    const past = [];
    for (let i = at - (at % 2); i >= 0 && frames[i].t_s > now_s - TRAIL_S; i -= 2) past.unshift(frames[i]);
    picture.exact = !playing;
    picture.show(at + 1 < frames.length ? between(frames[at], frames[at + 1], now_s) : frames[at], past);
    scrub.value = now_s;
    scrub.setAttribute("aria-valuetext", seconds(now_s));
    track.move(now_s);
  }

  function go(on) {
    playing = on;
    last = performance.now();
    setText(play, on ? "Pause" : "Play");
    if (on && now_s >= end_s) seek(0);
    if (on) requestAnimationFrame(tick);
    else seek(now_s);
  }

  function tick(time) {
    if (!playing) return;
    // With reduced motion, two still pictures a second.
    if (!still.matches || time - last > 500) {
      seek(now_s + Math.min(Math.max(time - last, 0) / 1000, 0.6) * speed.value);
      last = time;
    }
    if (now_s >= end_s) go(false);
    else requestAnimationFrame(tick);
  }

  play.addEventListener("click", () => go(!playing));
  scrub.addEventListener("input", () => seek(Number(scrub.value)));
  const faster = (by) => {
    speed.selectedIndex = Math.max(0, Math.min(speed.length - 1, speed.selectedIndex + by));
  };
  const frame = (by) => {
    go(false);
    seek(frames[Math.max(0, Math.min(frames.length - 1, at + by))].t_s);
  };
  const keys = {
    " ": () => go(!playing),
    ArrowLeft: () => seek(now_s - 1),
    ArrowRight: () => seek(now_s + 1),
    ",": () => frame(-1),
    ".": () => frame(1),
    Home: () => seek(0),
    End: () => seek(end_s),
    "+": () => faster(1),
    "=": () => faster(1),
    "-": () => faster(-1),
  };
  root.addEventListener("keydown", (event) => {
    const control = event.target.closest("button, select, summary, input:not(.scrub)");
    if (event.ctrlKey || event.metaKey || event.altKey || (event.shiftKey && event.key !== "+")) return;
    if (!keys[event.key] || (control && (event.key === " " || control.matches("select")))) return;
    event.preventDefault();
    keys[event.key]();
  });
  seek(0);
}

function live(root, scene, picture, control) {
  const [lamp, dropped, answer, log, end] = [".lamp", ".dropped", ".answer", ".log", ".end"].map((selector) => root.querySelector(selector));
  const track = new Track(root, scene, scene.duration_s ?? 60);
  for (const fault of scene.faults) track.mark(fault.t_s, fault.until_s, fault.what);
  const feed = globalThis.phalanxFeed;
  let [frames, waiting, drawn, received_ms, lost, ended] = [[], false, 0, 0, 0, false];

  function link(state, text) {
    lamp.dataset.link = state;
    setText(lamp, text);
  }

  function act(body) {
    setText(answer, "");
    const post = () => fetch("control" + location.search, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
    });
    (feed ? feed.act(body) : post()).then(async (response) => {
      if (response.ok) markMended(body.act, `${body.from}->${body.to}`);
      else setText(answer, `${body.act} ${body.robot ?? `${body.from} -> ${body.to}`}: ${(await response.text()) || response.status}`);
    }).catch(() => setText(answer, `${body.act}: the run does not answer`));
  }

  function button(parent, text, what, body) {
    const element = html(parent, "button", "", text);
    element.type = "button";
    element.setAttribute("aria-label", `${text} ${what}`);
    element.addEventListener("click", () => act(body()));
    return element;
  }

  const edges = scene.edges.map(({ from, to, spare }) => {
    const [sender, receiver] = [scene.robots[from].name, scene.robots[to].name];
    const row = html(root.querySelector(".edges tbody"), "tr");
    html(row, "th", "", `${sender} \u2192 ${receiver}`).scope = "row";
    const cell = html(row, "td", "state");
    if (!control || spare) return { row, cell };
    const acts = html(row, "td", "acts");
    const [cut, mend] = ["cut", "mend"].map((name) => button(acts, name, `${sender} to ${receiver}`, () => ({ act: name, from: sender, to: receiver })));
    mend.hidden = true;
    cut.disabled = scene.pace === "lockstep";
    if (cut.disabled) cut.title = "in lockstep, only the scenario can cut edges";
    return { row, cell, cut, mend, name: `${sender}->${receiver}` };
  });

  /** Shows that a user cut or mended an edge. Only edges that were cut by a user can be mended. */
  function markMended(act, name) {
    if (act !== "cut" && act !== "mend") return;
    for (const edge of edges) if (edge.mend && edge.name === name) [edge.cut.hidden, edge.mend.hidden] = [act === "cut", act === "mend"];
  }

  if (control) {
    for (const head of root.querySelectorAll(".robots thead tr, .edges thead tr")) html(head, "th", "", "inject fault").scope = "col";
    picture.robots.forEach((parts, i) => {
      const { name } = scene.robots[i];
      const acts = html(parts.row, "td", "acts");
      const addButton = (text, body = text) => button(acts, text, name, () => ({ act: typeof body === "string" ? body : body(), robot: name }));
      parts.kill = addButton("kill");
      parts.restart = addButton("restart");
      parts.restart.hidden = true;
      parts.freeze = addButton("freeze", () => (picture.frame?.robots[i].state === "frozen" ? "thaw" : "freeze"));
    });
    picture.changed = (i, state) => {
      const { kill, freeze, restart } = picture.robots[i];
      const name = state === "frozen" ? "thaw" : "freeze";
      setText(freeze, name);
      freeze.setAttribute("aria-label", `${name} ${scene.robots[i].name}`);
      kill.hidden = freeze.hidden = state === "dead";
      restart.hidden = !kill.hidden;
      kill.disabled = restart.disabled = ended;
      freeze.disabled = ended || !["moving", "orphaned", "frozen"].includes(state);
    };
  }

  /** Draws the newest frame, and skips all others that arrived since the last drawing. */
  function draw(time) {
    if (still.matches && time - drawn < 500 && !ended) return void requestAnimationFrame(draw);
    [waiting, drawn] = [false, time];
    const frame = frames.at(-1);
    picture.exact = ended;
    picture.show(frame, frames.slice(0, -1).filter((_, i) => i % 2 === 0));
    track.move(frame.t_s);
    edges.forEach(({ row, cell }, i) => {
      row.dataset.state = frame.edges[i];
      row.hidden = frame.edges[i] === "closed";
      setText(cell, frame.edges[i]);
    });
  }

  function take(event) {
    const frame = JSON.parse(event.data);
    received_ms = performance.now();
    if (frames.length && frame.t_s < frames.at(-1).t_s) frames = [];
    frames.push(frame);
    while (frame.t_s - frames[0].t_s > TRAIL_S || frames.length > 200) frames.shift();
    picture.include(frame, 0.15);
    track.add(frame);
    lost = frame.dropped ?? 0;
    setText(dropped, lost ? `${lost} frames not shown; the run is not affected` : "");
    if (frame.behind_ms > 250) link("behind", `the page is behind by ${(frame.behind_ms / 1000).toFixed(1)} s; the run is not affected`);
    else link("live", "live");
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }

  function happened(event) {
    const { t_s, kind, robot, detail, other } = JSON.parse(event.data);
    // Contacts are shown in the picture and the list of edges; they may change many times a second.
    if (kind === "contact") return;
    const item = document.createElement("li");
    item.append(`${seconds(t_s)} `);
    html(item, "b", "", `${kind} ${robot ?? ""}`);
    if (detail) item.append(` ${detail}`);
    log.prepend(item);
    while (log.childElementCount > 200) log.lastChild.remove();
    const edge = kind === "cut" || kind === "mend" ? `${other}->${robot}` : null;
    if (edge) markMended(kind, edge);
    if (kind !== "ready") markEvent(t_s, `${kind} ${edge ?? robot ?? ""}`, edge || ["kill", "restart", "freeze", "thaw"].includes(kind));
  }

  let group = null;
  /** Marks an event on the time line. Its immediate consequences are in the title of the mark. */
  function markEvent(t_s, what, act) {
    if (group && Math.abs(t_s - group.t_s) < 0.1 && (!act || group.acts.length < 2)) {
      group.all.push(what);
    } else if (track.marks.childElementCount < 300) {
      group = { t_s, all: [what], acts: [], mark: null };
    } else return;
    if (act) group.acts.push(what);
    const labels = group.acts.length ? group.acts : group.all.slice(0, 1);
    const more = group.all.length - labels.length;
    group.mark = track.mark(t_s, undefined, labels.join(", ") + (more ? ` (+${more})` : ""), undefined, group.mark);
    group.mark.title = group.all.map((each) => `${each}, at ${seconds(group.t_s)}`).join("; ");
  }

  function latency(event) {
    const rows = root.querySelector(".latency tbody");
    rows.replaceChildren();
    for (const { stage, worst, p50_us, p99_us, max_us, count } of JSON.parse(event.data)) {
      const row = html(rows, "tr");
      html(row, "th", "", stage).scope = "row";
      const numbers = [p50_us, p99_us, max_us].map((value) => (value == null ? "-" : String(+value.toPrecision(3))));
      for (const text of [worst, ...numbers, String(count)]) html(row, "td", "", text);
    }
  }

  function connect() {
    const source = feed ? feed.listen() : new EventSource("events" + location.search);
    source.addEventListener("message", take);
    source.addEventListener("happened", happened);
    source.addEventListener("latency", latency);
    source.addEventListener("ended", (event) => {
      const { exit, text } = JSON.parse(event.data);
      ended = true;
      source.close?.();
      link("ended", `the run has ended, exit code ${exit}`);
      setText(end, text);
      for (const element of root.querySelectorAll(".acts button")) element.disabled = true;
      if (frames.length) requestAnimationFrame(draw);
    });
    source.addEventListener("error", () => {
      if (ended) return;
      link("reconnecting", "no connection: trying again");
      if (source.readyState === EventSource.CLOSED) setTimeout(connect, 2000);
    });
  }

  setInterval(() => {
    track.flush();
    const silent_s = (performance.now() - received_ms) / 1000;
    if (!feed && received_ms && silent_s > 1 && !ended && lamp.dataset.link !== "reconnecting") link("behind", `no data for ${silent_s.toFixed(0)} s`);
  }, 500);
  connect();
}

for (const root of document.querySelectorAll(".phalanx-picture")) {
  const scene = JSON.parse(root.querySelector(".scene").textContent);
  const picture = new Picture(root, scene);
  if (root.dataset.mode === "replay") replay(root, scene, picture);
  else live(root, scene, picture, root.dataset.mode === "control");
}
