// The page: takes the pictures of the server and shows them.

const element = (id) => document.getElementById(id);
const words = (key) => key.replaceAll("_", " ");
const grouped = (value) => Math.round(value).toString().replace(/\B(?=(\d{3})+(?!\d))/g, " ");
const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−"));
const show = (id, text) => { const place = element(id); if (place.textContent !== text) place.textContent = text; };

const AGAIN_MS = 2000;
let machine = null, picture = null, points = [], pending = false;

// In lock-step ticks have the client's pace, and the machine has its own time: a millisecond per tick.
const isLockstep = () => Boolean(picture?.status?.machine?.lockstep);
const time = (point) => (isLockstep() ? point[3] * 1e-3 : point[0]);

function redraw() {
  if (pending) return;
  pending = true;
  requestAnimationFrame(() => {
    pending = false;
    drawMachine(element("machine"), machine, picture && picture.figure, Number(element("factor").value));
    drawPlot(element("plot"), points, time);
    drawForce(element("force"), picture && picture.status && picture.status.force);
  });
}

// Ticks per millisecond of the clock over the last points, with two digits.
function pace() {
  const last = points[points.length - 1], first = points[Math.max(0, points.length - 30)];
  return last && last[0] > first[0] ? Number(((last[3] - first[3]) * 1e-3 / (last[0] - first[0])).toPrecision(2)) : 1;
}

function showSigns(status) {
  const lockstep = element("lockstep"), lost = element("rows_lost");
  lockstep.hidden = !isLockstep();
  lost.hidden = !status.rows_lost;
  if (isLockstep()) show("lockstep", `lock-step · ${pace()} × real time`);
  show("clock", isLockstep() ? "of the machine's time" : "");
}

function showStatus(status) {
  show("phase", words(status.machine_failed ? "machine failed" : status.phase));
  element("phase").style.background = `var(--${status.machine_failed ? "fault" : status.phase})`;
  show("name", `${status.machine ? status.machine.name : "unknown"}, ${status.axes.length} axes`);
  show("epoch", String(status.epoch));
  show("tick", grouped(status.tick));
  show("cause", words(status.cause));
  show("ramp", `${fixed(status.ramp_ticks_left * 1e-3, 1)} s`);
  show("on_time", `${status.on_time} %`);
  element("share").value = status.on_time;
  const rows = element("axes").tBodies[0];
  while (rows.rows.length < status.axes.length) addRow(rows, rows.rows.length);
  while (rows.rows.length > status.axes.length) rows.deleteRow(-1);
  status.axes.forEach((axis, index) => {
    const cells = [
      fixed(axis.nominal_nm * 1e-6, 4), fixed(axis.offset.position_nm * 1e-3, 3),
      // Offsets that nothing acts on: computed in Submit alone.
      fixed(status.phase === "submit" ? axis.shadow_nm * 1e-3 : null, 3), fixed(axis.actual.position_nm * 1e-6, 4),
      fixed(axis.lag_nm === null ? null : axis.lag_nm * 1e-3, 1), fixed(axis.actual.velocity_um_s * 1e-3, 2), fixed(axis.actual.torque_permille * 0.1, 1),
      words(status.drives?.[index] ?? "–"),
    ];
    cells.forEach((text, column) => { const cell = rows.rows[index].cells[column + 1]; if (cell.textContent !== text) cell.textContent = text; });
    rows.rows[index].cells[0].querySelector(".flags").textContent = axis.flags.map(words).join(", ");
  });
  const joined = (vector, digits) => vector.map((v) => fixed(v, digits)).join("  ");
  show("force_text", status.force ? `${joined(status.force.slice(0, 3), 1)} N · ${joined(status.force.slice(3), 2)} N m` : "not measured");
  const micro = (vector) => (vector ? vector.map((v) => fixed(v * 1e6, 1)).join("  ") : "not measured");
  show("displacement", `${micro(status.displacement_m)}${status.displacement_m ? " µm" : ""}`);
  show("turn", `turn ${micro(status.turn_rad)}${status.turn_rad ? " µrad" : ""}`);
  show("gauges", `${micro(status.gauges_m)}${status.gauges_m ? " µm" : ""}`);
  const counters = element("counters");
  const { received, missed, ...others } = status.counters;
  const counts = { received, missed, longest_run: status.longest_miss_run, ...others };
  Object.entries(counts).forEach(([key, count], index) => {
    if (!counters.children[index]) {
      const cell = counters.appendChild(document.createElement("div"));
      cell.append(document.createElement("b"), document.createElement("span"));
      cell.lastChild.textContent = words(key);
    }
    counters.children[index].firstChild.textContent = grouped(count);
    counters.children[index].className = count > 0 && key !== "received" ? "warn" : "";
  });
}

function addRow(rows, index) {
  const row = rows.insertRow();
  ["", "nominal mm", "offset µm", "shadow µm", "actual mm", "lag µm", "v mm/s", "torque %", "drive"].forEach((label) => {
    row.insertCell().dataset.label = label;
  });
  const swatch = document.createElement("span"), flags = document.createElement("span");
  swatch.className = "swatch"; swatch.style.background = `var(--axis${index + 1})`; flags.className = "flags";
  row.cells[0].append(swatch, String(index + 1), flags);
}

function showLink(live, text) {
  document.body.className = live ? "live" : "lost";
  show("link", text);
}

function keep(point) {
  if (points.length && (time(point) < time(points[points.length - 1]) || point[2].length !== points[0][2].length)) points = [];
  points.push(point);
  while (time(points[0]) < time(point) - SPAN_S) points.shift();
}

// What the machine is not drawn for, if it is not.
function showStranger(text) {
  element("not_drawn").hidden = element("stranger").hidden = !text;
  element("hint").hidden = Boolean(text);
  show("stranger", text || "");
}

function showPicture(next) {
  picture = next.status ? next : { ...picture, ...next };
  showLink(next.live, next.live ? `live · ${next.server}` : next.trouble);
  if (next.status) {
    showStranger(next.stranger);
    showStatus(next.status);
    keep(next.point);
    showSigns(next.status);
  }
  // The raw object, for tests and for the curious: equal to what `gantry-tau monitor --status` prints.
  document.body.dataset.tick = next.status ? String(next.status.tick) : "";
  window.gantryTau = picture;
  redraw();
}

function listen() {
  const source = new EventSource("live");
  source.addEventListener("machine", (event) => { machine = JSON.parse(event.data); redraw(); });
  source.addEventListener("history", (event) => { points = JSON.parse(event.data); redraw(); });
  source.addEventListener("events", (event) => {
    element("list").replaceChildren(...JSON.parse(event.data).map(([time, text]) => {
      const line = document.createElement("li"), at = document.createElement("time");
      at.textContent = time;
      line.append(at, text);
      return line;
    }));
  });
  source.onmessage = (event) => showPicture(JSON.parse(event.data));
  source.onerror = () => {
    const isOver = source.readyState === EventSource.CLOSED;
    // A browser tries again after a lost connection, not after an answer that is not a stream of events: a proxy's, of a monitor that is down.
    if (isOver) setTimeout(listen, AGAIN_MS);
    showLink(false, isOver ? "what answers is not the monitor (a proxy?); trying again" : "the monitor does not answer; trying again");
  };
}

PHASES.forEach((phase) => {
  const one = element("key").appendChild(document.createElement("span"));
  one.textContent = words(phase);
  one.style.background = `var(--${phase})`;
});
readPalette();
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readPalette(); redraw(); });
element("factor").addEventListener("change", redraw);
window.addEventListener("resize", redraw);
orbit(element("machine"), redraw);
listen();
