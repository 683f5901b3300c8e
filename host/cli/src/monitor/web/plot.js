// Offsets over the last minute, with the phase as background; and the bars of the load.

const PHASES = ["listening", "handshake", "submit", "obtain", "safe_disconnect", "fault"];
const SPAN_S = 60;

// Step of 1, 2 or 5 times a power of ten that splits a range into at most `most` parts.
function step(range, most) {
  const power = 10 ** Math.floor(Math.log10(range / most));
  return [1, 2, 5, 10].map((times) => times * power).find((one) => range / one <= most);
}

// A point: [seconds, phase, offsets in µm, tick]. `time` is that of a point, s: of the clock, or of the machine in lock-step.
function drawPlot(canvas, points, time) {
  const { context, width, height } = fitted(canvas);
  if (points.length < 2) return;
  const area = { left: 58, right: width - 8, top: 6, bottom: height - 24 };
  const end = time(points[points.length - 1]), begin = end - SPAN_S;
  const values = points.flatMap((point) => point[2]);
  let [low, high] = [Math.min(0, ...values), Math.max(0, ...values)];
  if (high - low < 1) [low, high] = [low - 0.5, high + 0.5];
  const margin = 0.06 * (high - low);
  [low, high] = [low - margin, high + margin];
  const x = (s) => area.left + (s - begin) / SPAN_S * (area.right - area.left);
  const y = (v) => area.bottom - (v - low) / (high - low) * (area.bottom - area.top);
  context.save();
  context.beginPath(); context.rect(area.left, area.top, area.right - area.left, area.bottom - area.top); context.clip();
  let since = 0;
  for (let i = 1; i <= points.length; i++) {
    if (i === points.length || points[i][1] !== points[since][1]) {
      context.fillStyle = palette[points[since][1]] || palette.paper;
      const [a, b] = [x(time(points[since])), x(time(points[Math.min(i, points.length - 1)]))];
      context.fillRect(a, area.top, b - a + 0.5, area.bottom - area.top);
      since = i;
    }
  }
  context.restore();
  context.font = "11px system-ui, sans-serif"; context.fillStyle = palette.soft; context.strokeStyle = palette.soft + "38"; context.lineWidth = 1;
  context.textAlign = "right";
  const by = step(high - low, 6);
  for (let v = Math.ceil(low / by) * by; v <= high; v += by) {
    context.beginPath(); context.moveTo(area.left, y(v)); context.lineTo(area.right, y(v)); context.stroke();
    context.fillText(String(Number(v.toFixed(6))).replace("-", "−"), area.left - 6, y(v) + 4);
  }
  context.textAlign = "center";
  for (let s = 0; s <= SPAN_S; s += 10) context.fillText(s ? `−${s} s` : "now", Math.min(x(end - s), area.right - 10), height - 7);
  context.save();
  context.beginPath(); context.rect(area.left, area.top, area.right - area.left, area.bottom - area.top); context.clip();
  context.lineWidth = 2; context.lineJoin = "round";
  for (let axis = 0; axis < points[0][2].length; axis++) {
    context.strokeStyle = palette.axes[axis]; context.beginPath();
    let before = null;
    for (const point of points) {
      // A gap in what was received is a gap in the line.
      if (before === null || point[0] - before > 0.5) context.moveTo(x(time(point)), y(point[2][axis]));
      else context.lineTo(x(time(point)), y(point[2][axis]));
      before = point[0];
    }
    context.stroke();
  }
  context.restore();
  context.textAlign = "left";
}

let reach = 100;
function drawForce(canvas, force) {
  const { context, width, height } = fitted(canvas);
  if (!force) return;
  const largest = Math.max(...force.slice(0, 3).map(Math.abs));
  while (reach < largest) reach *= 2;
  const row = height / 3, middle = 26 + (width - 26) / 2, half = (width - 26) / 2 - 4;
  context.font = "12px system-ui, sans-serif";
  ["x", "y", "z"].forEach((axis, index) => {
    const top = index * row + 4, size = row - 9, bar = force[index] / reach * half;
    context.fillStyle = palette.ground; context.fillRect(middle - half, top, 2 * half, size);
    context.fillStyle = bar < 0 ? palette.pull : palette.push; context.fillRect(Math.min(middle, middle + bar), top, Math.abs(bar), size);
    context.fillStyle = palette.soft; context.fillRect(middle - 0.5, top - 2, 1, size + 4);
    context.fillStyle = palette.ink; context.fillText(`F${axis}`, 0, top + size / 2 + 4);
  });
}
