// SPDX-License-Identifier: Apache-2.0
// The composed map on a canvas, and the readings: see docs/viewer-protocol.md.

const HELLO = 1, SUBMAP = 2, SUBMAP_PATCH = 3, SUBMAP_POSES = 4, READINGS = 9;
const MAX_PIXELS = 4e6;
const canvas = document.getElementById("map");
const readings = document.getElementById("readings");
let hello = null, submaps = new Map(), poses = [], work = Promise.resolve(), drawing = 0;

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(`${scheme}//${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  submaps = new Map();
  poses = [];
  socket.onmessage = (event) => {
    work = work.then(() => receive(event.data)).catch((error) => { readings.value = String(error); });
  };
  socket.onclose = () => { readings.value = "no connection"; setTimeout(connect, 1000); };
}

async function receive(buffer) {
  const view = new DataView(buffer);
  for (let start = 0; start < buffer.byteLength;) {
    const length = view.getUint32(start, true), type = view.getUint16(start + 4, true);
    await take(type, buffer, start + 8, length);
    start += 8 + Math.ceil(length / 8) * 8;
  }
  drawing ||= setTimeout(draw, 200);
}

async function take(type, buffer, at, length) {
  const json = () => JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, at, length)));
  const words = length >= 32 ? new Uint32Array(buffer, at, 8) : null;
  if (type === HELLO) hello = json();
  if (type === READINGS) {
    const now = json();
    readings.value = `${now.text}: ${now.scans} scans, ${now.loop_closures} loop closures`;
  }
  if (type === SUBMAP_POSES) {
    poses = Array.from(new Float64Array(buffer, at + 16, 3 * new Uint32Array(buffer, at, 4)[1]));
  }
  if (type === SUBMAP) {
    const [id, version, , rows, cols] = words;
    const [x, y, resolution] = new Float64Array(buffer, at + 24, 3);
    const cells = await inflate(buffer, at + 48, length - 48);
    submaps.set(id, { version, rows, cols, x, y, resolution, cells });
  }
  if (type === SUBMAP_PATCH) {
    const [id, base, version, row, col, rows, cols] = words;
    const submap = submaps.get(id);
    if (submap?.version !== base) return;
    const cells = await inflate(buffer, at + 32, length - 32);
    for (let r = 0; r < rows; r++) {
      submap.cells.set(cells.subarray(r * cols, (r + 1) * cols), (row + r) * submap.cols + col);
    }
    submap.version = version;
  }
}

async function inflate(buffer, at, length) {
  const packed = new Blob([new Uint8Array(buffer, at, length)]).stream();
  const stream = packed.pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Every corner of every submap, in the map.
function* corners() {
  for (const [id, s] of submaps) {
    if (3 * id + 2 >= poses.length || s.cells.length === 0) continue;
    const [x, y, theta] = poses.slice(3 * id, 3 * id + 3);
    const cos = Math.cos(theta), sin = Math.sin(theta);
    for (const u of [s.x, s.x + s.cols * s.resolution]) {
      for (const v of [s.y, s.y + s.rows * s.resolution]) {
        yield [x + cos * u - sin * v, y + sin * u + cos * v];
      }
    }
  }
}

function draw() {
  drawing = 0;
  let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of corners()) {
    [left, right] = [Math.min(left, x), Math.max(right, x)];
    [bottom, top] = [Math.min(bottom, y), Math.max(top, y)];
  }
  if (!hello || left > right) return;
  const area = (right - left) * (top - bottom);
  const edge = hello.resolution * Math.ceil(Math.sqrt(area / MAX_PIXELS) / hello.resolution);
  const width = Math.ceil((right - left) / edge), height = Math.ceil((top - bottom) / edge);
  const sum = new Float32Array(width * height), known = new Uint8Array(width * height);
  for (const [id, s] of submaps) {
    if (3 * id + 2 < poses.length && s.cells.length) add(id, s, left, top, edge, width, height, sum, known);
  }
  const image = new ImageData(width, height);
  for (let i = 0; i < sum.length; i++) {
    const odds = Math.min(Math.max(sum[i], -hello.max_log_odds), hello.max_log_odds);
    const colour = hello.palette[known[i] ? Math.round(255 / (1 + Math.exp(-odds))) : 256];
    image.data.set([...colour, 255], 4 * i);
  }
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(image, 0, 0);
}

function add(id, s, left, top, edge, width, height, sum, known) {
  const [x, y, theta] = poses.slice(3 * id, 3 * id + 3);
  const cos = Math.cos(theta) / s.resolution, sin = Math.sin(theta) / s.resolution;
  const at = (r, c) => (r < 0 || c < 0 || r >= s.rows || c >= s.cols ? 0 : s.cells[r * s.cols + c]);
  const evidence = (r, c) => { const cell = at(r, c); return cell ? hello.log_odds[cell] : 0; };
  for (let row = 0; row < height; row++) {
    const dy = top - (row + 0.5) * edge - y;
    for (let col = 0; col < width; col++) {
      const dx = left + (col + 0.5) * edge - x;
      const u = cos * dx + sin * dy - s.x / s.resolution;
      const v = cos * dy - sin * dx - s.y / s.resolution;
      if (!at(Math.floor(v + 0.5), Math.floor(u + 0.5))) continue;
      const c = Math.floor(u), r = Math.floor(v), fu = u - c, fv = v - r;
      const lower = (1 - fu) * evidence(r, c) + fu * evidence(r, c + 1);
      const upper = (1 - fu) * evidence(r + 1, c) + fu * evidence(r + 1, c + 1);
      sum[row * width + col] += (1 - fv) * lower + fv * upper;
      known[row * width + col] = 1;
    }
  }
}

connect();
