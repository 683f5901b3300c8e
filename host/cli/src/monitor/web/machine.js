// The machine in three dimensions: parallel projection of the picture's points, painted from the far to the near.

// Colours of the style sheet, which canvases need as values; `#rrggbb`.
let palette = {};
function readPalette() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  palette = Object.fromEntries(["ink", "soft", "line", "paper", "ground", "accent", "grid", "rail", "rail-light", "plate", "tool", "push", "pull",
    "listening", "handshake", "submit", "obtain", "safe_disconnect", "fault"].map((name) => [name, of(name)]));
  palette.axes = [1, 2, 3, 4, 5, 6].map((number) => of(`axis${number}`));
}

const START = { azimuth: 1.05, elevation: 0.42, zoom: 1 };
const camera = { ...START };

const add = (a, b, share = 1) => [a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const length = (a) => Math.sqrt(dot(a, a));

function directions() {
  const [sa, ca, se, ce] = [Math.sin(camera.azimuth), Math.cos(camera.azimuth), Math.sin(camera.elevation), Math.cos(camera.elevation)];
  return { right: [-sa, ca, 0], down: [se * ca, se * sa, -ce], towards: [ce * ca, ce * sa, se] };
}

function fitted(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

// Corners of a cart's box: bits 4, 2, 1 of the number choose the side along each edge.
function corners(arm, moved) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((number) => arm.half_edges.reduce(
    (place, edge, index) => add(place, edge, number & (4 >> index) ? 1 : -1), add(arm.centre, moved)));
}
const FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];

// The part of the guideway that is drawn reaches at least as far as its cart.
function rail(arm, moved) {
  const along = add(arm.rail[1], arm.rail[0], -1);
  const unit = add([0, 0, 0], along, 1 / length(along));
  const at = dot(add(add(arm.centre, moved), arm.rail[0], -1), unit);
  const margin = 0.15 * length(along);
  return [add(arm.rail[0], unit, Math.min(0, at - margin)), add(arm.rail[0], unit, Math.max(length(along), at + margin))];
}

function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const side = (all) => {
    const kept = [];
    for (const p of all) {
      while (kept.length > 1) {
        const [a, b] = kept.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        kept.pop();
      }
      kept.push(p);
    }
    return kept.slice(0, -1);
  };
  return [...side(sorted), ...side(sorted.reverse())];
}

function drawMachine(canvas, machine, figure, factor) {
  const { context, width, height } = fitted(canvas);
  if (!machine || !figure) return;
  const { right, down, towards } = directions();
  const rails = machine.arms.map((arm, index) => rail(arm, figure.carts[index]));
  const boxes = machine.arms.map((arm, index) => corners(arm, figure.carts[index]));
  const all = [...rails.flat(), ...boxes.flat(), ...figure.platform];
  const extent = (axis) => { const v = all.map((p) => dot(p, axis)); return [Math.min(...v), Math.max(...v)]; };
  // The scale does not change while the machine turns: it fits the ball around the scene.
  const low = [0, 1, 2].map((i) => Math.min(...all.map((p) => p[i])));
  const high = [0, 1, 2].map((i) => Math.max(...all.map((p) => p[i])));
  const middle = add(add([0, 0, 0], low, 0.5), high, 0.5);
  const [xs, ys] = [extent(right), extent(down)];
  const fit = Math.min((width - 90) / (xs[1] - xs[0]), (height - 90) / (ys[1] - ys[0]));
  const ball = 1.35 * Math.min(width, height) / length(add(high, low, -1));
  const scale = Math.min(fit, ball) * camera.zoom;
  const centre = [(xs[0] + xs[1]) / 2, (ys[0] + ys[1]) / 2];
  const at = (p) => [width / 2 + (dot(p, right) - centre[0]) * scale, height / 2 + (dot(p, down) - centre[1]) * scale];
  const line = (ends, colour, thick, dash = [], cap = "round") => {
    context.strokeStyle = colour; context.lineWidth = thick; context.setLineDash(dash); context.lineCap = cap;
    context.beginPath(); context.moveTo(...at(ends[0])); context.lineTo(...at(ends[1])); context.stroke();
    context.setLineDash([]);
  };
  const shape = (points, fill, stroke, thick = 1) => {
    context.beginPath(); points.forEach((p, i) => (i ? context.lineTo(...p) : context.moveTo(...p))); context.closePath();
    if (fill) { context.fillStyle = fill; context.fill(); }
    if (stroke) { context.strokeStyle = stroke; context.lineWidth = thick; context.stroke(); }
  };
  const ball2 = (p, radius, fill, stroke) => {
    context.beginPath(); context.arc(...at(p), radius, 0, 7); context.fillStyle = fill; context.fill();
    context.strokeStyle = stroke; context.lineWidth = 1.6; context.stroke();
  };
  const name = (text, p, colour, dx = 9, dy = -9) => {
    const [x, y] = at(p);
    context.font = "13px system-ui, sans-serif"; context.lineWidth = 4; context.strokeStyle = palette.paper + "d0"; context.fillStyle = colour;
    context.strokeText(text, x + dx, y + dy); context.fillText(text, x + dx, y + dy);
  };

  // Ground: a grid at the lowest point.
  const grid = 0.25;
  const from = low.map((v) => Math.floor(v / grid - 1) * grid), to = high.map((v) => Math.ceil(v / grid + 1) * grid);
  for (let x = from[0]; x <= to[0] + 1e-9; x += grid) line([[x, from[1], low[2]], [x, to[1], low[2]]], palette.grid, 1);
  for (let y = from[1]; y <= to[1] + 1e-9; y += grid) line([[from[0], y, low[2]], [to[0], y, low[2]]], palette.grid, 1);

  const parts = [];
  const part = (points, paint) => parts.push({ depth: points.reduce((sum, p) => sum + dot(p, towards), 0) / points.length, paint });
  machine.arms.forEach((arm, index) => {
    const [a, b] = rails[index];
    // In pieces, so that a cart hides what is behind it and not the whole guideway.
    for (let piece = 0; piece < 12; piece++) {
      const ends = [piece, piece + 1].map((step) => add(a, add(b, a, -1), step / 12 + (step > piece ? 0.002 : 0)));
      part(ends, () => { line(ends, palette.rail, 7, [], "butt"); line(ends, palette["rail-light"], 2.5, [], "butt"); });
    }
    FACES.forEach((face) => {
      const points = face.map((corner) => boxes[index][corner]);
      part(points, () => shape(points.map(at), palette.axes[index] + "38", palette.axes[index] + "b0"));
    });
    const on = figure.joints.filter((_, link) => machine.links[link].arm === index);
    const hub = add(arm.centre, figure.carts[index]);
    if (machine.axes > 3) on.forEach((joint) => part([joint, hub], () => line([hub, joint], palette.axes[index] + "90", 4)));
  });
  machine.links.forEach((link, index) => {
    const ends = [figure.joints[index], figure.platform[index]];
    part(ends, () => {
      line(ends, palette.paper, 7); line(ends, palette.axes[link.arm], 4);
      ends.forEach((end) => ball2(end, 4.2, palette.paper, palette.axes[link.arm]));
    });
  });
  const plate = hull([...figure.platform, figure.tool].map(at));
  part(figure.platform, () => shape(plate, palette.plate + "33", palette.plate, 1.4));
  parts.sort((a, b) => a.depth - b.depth).forEach((one) => one.paint());
  ball2(figure.tool, 5, palette.paper, palette.tool);
  machine.arms.forEach((arm, index) => name(`cart ${index + 1}`, add(arm.centre, figure.carts[index]), palette.axes[index], 14, -16));

  drawMagnified();
  drawTriad(context, height, right, down);

  // What differs from the nominal machine, magnified: carts by their offsets, the platform by its displacement.
  function drawMagnified() {
    machine.arms.forEach((arm, index) => {
      const start = add(arm.centre, figure.carts[index]);
      const moved = add([0, 0, 0], figure.cart_offsets[index], factor);
      const box = corners(arm, add(figure.carts[index], moved)).map(at);
      shape(hull(box), palette.accent + "10", palette.accent, 1.2);
      arrow(start, add(start, moved));
    });
    if (!figure.platform_displacements) return;
    const platform = figure.platform.map((p, i) => add(p, figure.platform_displacements[i], factor));
    const joints = figure.joints.map((p, i) => add(p, figure.joint_offsets[i], factor));
    platform.forEach((end, i) => line([joints[i], end], palette.accent + "a0", 1.2, [5, 4]));
    const tool = add(figure.tool, figure.tool_displacement, factor);
    shape(hull([...platform, tool].map(at)), palette.accent + "14", palette.accent, 1.4);
    arrow(figure.tool, tool);
    ball2(tool, 4, palette.accent, palette.paper);
    name("tool", tool, palette.accent);
  }
  function arrow(a, b) {
    const [from2, to2] = [at(a), at(b)];
    const way = [to2[0] - from2[0], to2[1] - from2[1]], size = Math.hypot(...way);
    if (size < 3) return;
    line([a, b], palette.accent, 2.4);
    const [ux, uy] = [way[0] / size, way[1] / size], head = Math.min(9, size);
    shape([to2, [to2[0] - head * ux - head / 2 * uy, to2[1] - head * uy + head / 2 * ux], [to2[0] - head * ux + head / 2 * uy, to2[1] - head * uy - head / 2 * ux]], palette.accent);
  }
}

function drawTriad(context, height, right, down) {
  const origin = [48, height - 48];
  context.font = "12px system-ui, sans-serif"; context.fillStyle = palette.soft; context.strokeStyle = palette.soft; context.lineWidth = 1.5;
  ["x", "y", "z"].forEach((text, index) => {
    const way = [right[index] * 30, down[index] * 30];
    if (Math.hypot(...way) < 5) return;
    context.beginPath(); context.moveTo(...origin); context.lineTo(origin[0] + way[0], origin[1] + way[1]); context.stroke();
    context.fillText(text, origin[0] + way[0] * 1.35 - 3, origin[1] + way[1] * 1.35 + 4);
  });
}

function orbit(canvas, redraw) {
  let last = null;
  canvas.addEventListener("pointerdown", (event) => { last = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  ["pointerup", "pointercancel"].forEach((end) => canvas.addEventListener(end, () => { last = null; }));
  canvas.addEventListener("pointermove", (event) => {
    if (!last) return;
    camera.azimuth -= (event.clientX - last[0]) * 0.008;
    camera.elevation = Math.min(1.55, Math.max(-1.55, camera.elevation + (event.clientY - last[1]) * 0.008));
    last = [event.clientX, event.clientY];
    redraw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom = Math.min(8, Math.max(0.4, camera.zoom * Math.exp(-event.deltaY * 0.001)));
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { Object.assign(camera, START); redraw(); });
}
