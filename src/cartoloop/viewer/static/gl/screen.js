// SPDX-License-Identifier: Apache-2.0
/**
 * What was drawn last, kept with a margin around it, so that panning only has to draw now and then what
 * comes into sight: without a graphics card that is the difference between stuttering and gliding.
 * @module
 */
import { CORNER, createTarget, createTexture, Program } from "./context.js";

/** How far the map can be moved before more of it has to be drawn [device px]. */
export const MARGIN = 96;

const VERTEX = `
  ${CORNER}
  void main() { gl_Position = vec4(2.0 * corner() - 1.0, 0.0, 1.0); }`;
const FRAGMENT = `
  uniform sampler2D picture;
  uniform ivec2 offset;
  out vec4 pixel;
  void main() { pixel = texelFetch(picture, ivec2(gl_FragCoord.xy) + offset, 0); }`;

/** @typedef {[number, number, number, number]} Rect left, bottom, width, height [device px] */

/** Two pictures: of one a window is shown, the other takes what is left of it after a pan. */
export class Screen {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.program = new Program(gl, VERTEX, FRAGMENT);
    this.vertices = gl.createVertexArray();
    this.width = this.height = 0;
    this.targets = [];
    this.textures = [];
    /** What of the picture has been drawn. @type {Rect} */
    this.valid = [0, 0, 0, 0];
  }

  /** The framebuffer that is drawn into. */
  get target() {
    return this.targets[0];
  }

  get isValid() {
    return this.valid[2] > 0;
  }

  /** All of the picture, with its margin. @returns {Rect} */
  get all() {
    return [0, 0, this.width, this.height];
  }

  /** What of it is shown when it has just been drawn. @returns {Rect} */
  get window() {
    return [MARGIN, MARGIN, this.width - 2 * MARGIN, this.height - 2 * MARGIN];
  }

  invalidate() {
    this.valid = [0, 0, 0, 0];
  }

  resize() {
    const { gl } = this;
    const [width, height] = [gl.drawingBufferWidth + 2 * MARGIN, gl.drawingBufferHeight + 2 * MARGIN];
    if (width === this.width && height === this.height) return;
    for (const target of this.targets) gl.deleteFramebuffer(target);
    for (const texture of this.textures) gl.deleteTexture(texture);
    this.textures = [0, 1].map(() => createTexture(gl, gl.RGBA8, width, height));
    this.targets = this.textures.map((texture) => createTarget(gl, texture));
    [this.width, this.height] = [width, height];
    this.invalidate();
  }

  /** Whether a window of this offset can be shown. */
  holds([x, y]) {
    const [left, bottom, width, height] = this.valid;
    const [, , w, h] = this.window;
    return x >= left && y >= bottom && x + w <= left + width && y + h <= bottom + height;
  }

  /**
   * Move the picture; return what must be drawn again.
   * @param {number} dx to the right
   * @param {number} dy upwards
   * @returns {Rect[]}
   */
  move(dx, dy) {
    const { gl, width, height } = this;
    const [left, bottom, w, h] = this.valid;
    const [x0, x1] = [Math.max(0, left + dx), Math.min(width, left + w + dx)];
    const [y0, y1] = [Math.max(0, bottom + dy), Math.min(height, bottom + h + dy)];
    if (x0 >= x1 || y0 >= y1) return [this.all];
    // A copy, not a blit: of these, that is the one that is cheap without a graphics card.
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[0]);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[1]);
    gl.copyTexSubImage2D(gl.TEXTURE_2D, 0, x0, y0, x0 - dx, y0 - dy, x1 - x0, y1 - y0);
    this.targets.reverse();
    this.textures.reverse();
    return [[0, 0, x0, height], [x1, 0, width - x1, height], [x0, 0, x1 - x0, y0],
      [x0, y1, x1 - x0, height - y1]].filter((rect) => rect[2] > 0 && rect[3] > 0);
  }

  /** Show a window of the picture. @param {[number, number]} offset */
  present(offset) {
    const { gl } = this;
    const at = this.program.use();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[0]);
    gl.uniform2i(at.offset, ...offset);
    gl.bindVertexArray(this.vertices);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
  }
}
