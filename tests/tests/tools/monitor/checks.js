// Checks of the page at one size in one colour scheme; each failure is a sentence.

// A session in a crisis: every number is long, every flag set on each of six axes.
function crisis(status) {
  const axis = {
    ...status.axes[0], nominal_nm: -1234567890, lag_nm: -12345600,
    offset: { position_nm: -1999999, velocity_um_s: -2000000, torque_permille: -1000 },
    actual: { position_nm: -1234567890, velocity_um_s: -2000000, torque_permille: -1000 },
    flags: ["clamped", "position_limited", "velocity_limited", "torque_limited", "nominal_step", "nominal_accel"],
  };
  return {
    ...status, phase: "safe_disconnect", cause: "handshake_timeout", tick: 1234567890, epoch: 1234, rows_lost: true,
    axes: Array(6).fill(axis), drives: Array(6).fill("quick_stop"),
    counters: Object.fromEntries(Object.keys(status.counters).map((key) => [key, 1234567])),
    force: Array(6).fill(-1234.5), gauges_m: Array(3).fill(-1.2345e-3), displacement_m: Array(3).fill(-1.2345e-3),
    machine: { name: "/home/someone/machines/calibrated-with-a-long-name.toml", kinematics: "5f3a09c1", lockstep: true },
  };
}

const shownElements = () => [...document.querySelectorAll("body *")].filter((one) => one.checkVisibility());
const named = (one) => `${one.tagName.toLowerCase()}${one.id ? `#${one.id}` : ""} "${one.textContent.trim().slice(0, 30)}"`;

// Red, green, blue, 0 to 255, and alpha.
const channels = (colour) => {
  const [r, g, b, a = 1] = colour.match(/[\d.]+/g).map(Number);
  return [r, g, b, a];
};
const luminance = (colour) => {
  const [r, g, b] = channels(colour).map((value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
function ground(one) {
  for (let place = one; place; place = place.parentElement) {
    const colour = getComputedStyle(place).backgroundColor;
    if (channels(colour)[3] === 1) return colour;
  }
  return "rgb(255, 255, 255)";
}

function isPainted(canvas) {
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return pixels.some((value) => value > 0);
}

function failures(width, dark) {
  const found = [];
  const must = (is, text) => { if (!is) found.push(text); };
  must(innerWidth === width, `the page is ${innerWidth} wide`);
  must(document.documentElement.scrollWidth <= innerWidth, `it scrolls sideways: ${document.documentElement.scrollWidth}`);
  // The scheme is the one that was asked for, and every text is readable on its ground (WCAG: 4.5).
  must(luminance(ground(document.body)) < 0.2 === dark, `its ground is ${ground(document.body)}`);
  shownElements().filter((one) => [...one.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.textContent.trim())).forEach((one) => {
    const lights = [luminance(getComputedStyle(one).color), luminance(ground(one))].sort((a, b) => b - a);
    const contrast = (lights[0] + 0.05) / (lights[1] + 0.05);
    must(contrast >= 4.5, `${named(one)} has contrast ${contrast.toFixed(2)}`);
  });
  // The table is whole: all cells are within its panel, and no number is wider than its cell.
  const panel = element("numbers").getBoundingClientRect();
  const cells = [...document.querySelectorAll("#axes td")];
  must(cells.length === 54, `${cells.length} cells`);
  cells.forEach((cell) => {
    const { left, right, width: room } = cell.getBoundingClientRect();
    must(room > 0 && left >= panel.left && right <= panel.right && cell.scrollWidth <= Math.ceil(room), `${named(cell)} is cut`);
  });
  // Nor is anything else cut at the right.
  shownElements().forEach((one) => {
    must(one.getBoundingClientRect().right <= innerWidth + 0.5, `${named(one)} ends outside`);
  });
  ["machine", "plot", "force"].forEach((id) => must(isPainted(element(id)), `${id} is not painted`));
  // Phase and link are announced, and stay in sight at the end of the page.
  window.scrollTo(0, document.documentElement.scrollHeight);
  ["phase", "link"].forEach((id) => {
    const { top, bottom, left, right } = element(id).getBoundingClientRect();
    must(top >= 0 && bottom <= innerHeight && left >= 0 && right <= innerWidth && bottom > top, `${id} is out of sight: ${top} to ${bottom}`);
    must(element(id).getAttribute("aria-live") === "polite", `${id} is not announced`);
  });
  return found;
}

// Shows a crisis of the server's machine, and sends the failures to the page around this one.
function report(parts, status, width, dark) {
  const shown = crisis(status);
  const still = (count) => Array(count).fill([0, 0, 0]);
  const figure = {
    carts: still(3), joints: still(6), platform: still(6).map((_, i) => [i * 0.01, i % 2, 0.1]), tool: [0, 0, 0],
    cart_offsets: still(3), joint_offsets: still(6), platform_displacements: still(6), tool_displacement: [0, 0, 0],
  };
  const point = (s) => [s, shown.phase, [0, -s, s, 2 * s, -2 * s, 5], s * 1e3];
  machine = parts;
  points = Array.from({ length: 60 }, (_, s) => point(s));
  showPicture({ live: true, server: "127.0.0.1:7003", status: shown, figure, stranger: null, point: point(60) });
  // Canvases are painted with the next frame.
  setTimeout(() => parent.postMessage(JSON.stringify(failures(width, dark)), "*"), 500);
}
