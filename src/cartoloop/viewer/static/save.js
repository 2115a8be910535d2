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
