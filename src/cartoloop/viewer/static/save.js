// SPDX-License-Identifier: Apache-2.0
/**
 * Pictures to keep.
 * @module
 */

/** Have a file downloaded. @param {Blob} blob @param {string} name */
export function saveBlob(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const FOOT_PX = 44;
const EDGE_PX = 16;

/**
 * Write under a picture what it shows: name and facts of the map, and how long a length in it is.
 * @param {CanvasRenderingContext2D} context in CSS pixels
 * @param {{width: number, height: number, scale: number}} view
 * @param {{title: string, facts: string, metres: number, length: string}} about
 */
export function drawFoot(context, view, { title, facts, metres, length }) {
  const style = getComputedStyle(document.documentElement);
  const family = getComputedStyle(document.body).fontFamily;
  const [top, middle] = [view.height - FOOT_PX, view.height - FOOT_PX / 2];
  context.fillStyle = style.getPropertyValue("--card");
  context.fillRect(0, top, view.width, FOOT_PX);
  context.fillStyle = context.strokeStyle = style.getPropertyValue("--ink");
  Object.assign(context, { textBaseline: "middle", lineWidth: 1.5, textAlign: "right", font: `13px ${family}` });
  const end = view.width - EDGE_PX;
  context.fillText(length, end, middle);
  const right = end - context.measureText(length).width - 8;
  const left = right - metres * view.scale;
  context.beginPath();
  for (const [x, y] of [[left, middle - 5], [left, middle + 4], [right, middle + 4], [right, middle - 5]]) {
    context.lineTo(x, y);
  }
  context.stroke();
  Object.assign(context, { textAlign: "left", font: `600 14px ${family}` });
  const room = left - 2 * EDGE_PX;
  context.fillText(title, EDGE_PX, middle, room);
  const used = EDGE_PX + context.measureText(title).width + 16;
  context.font = `13px ${family}`;
  if (used + context.measureText(facts).width < room) context.fillText(facts, used, middle);
}

/**
 * Save what is on the screen.
 * @param {HTMLCanvasElement} canvas
 * @param {string} title
 * @param {() => void} draw a canvas of WebGL holds its picture only until it is shown
 * @param {(context: CanvasRenderingContext2D) => void} drawOver what is not in that canvas
 */
export function savePng(canvas, title, draw, drawOver) {
  const picture = document.createElement("canvas");
  Object.assign(picture, { width: canvas.width, height: canvas.height });
  const context = picture.getContext("2d");
  draw();
  context.drawImage(canvas, 0, 0);
  drawOver(context);
  picture.toBlob((blob) => blob && saveBlob(blob, `${title}-view.png`), "image/png");
}
