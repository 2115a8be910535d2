// SPDX-License-Identifier: Apache-2.0
/**
 * Lines and dots over the map, smooth, of any width.
 * @module
 */
import { CORNER, Program, QuadIndices } from "./context.js";

const LINE_VERTEX = `
  layout(location = 0) in vec2 begin;
  layout(location = 1) in vec2 end;
  layout(location = 2) in vec4 ink;
  uniform mat3 clip_from;
  uniform vec2 screen;
  uniform float width;
  uniform vec4 tint;
  out float across;
  out vec4 colour;
  ${CORNER}
  void main() {
    vec2 a = (clip_from * vec3(begin, 1.0)).xy * screen;
    vec2 b = (clip_from * vec3(end, 1.0)).xy * screen;
    vec2 way = b - a;
    float far = length(way);
    vec2 along = far > 1e-6 ? way / far : vec2(1.0, 0.0);
    float reach = width / 2.0 + 0.7;
    vec2 side = corner() * 2.0 - 1.0;
    across = side.y * reach;
    vec2 at = (side.x < 0.0 ? a : b) + along * side.x * 0.3 * width
      + vec2(-along.y, along.x) * across;
    colour = ink * tint;
    gl_Position = vec4(at / screen, 0.0, 1.0);
  }`;

const LINE_FRAGMENT = `
  uniform float width;
  in float across;
  in vec4 colour;
  out vec4 pixel;
  void main() {
    float cover = clamp(width / 2.0 + 0.5 - abs(across), 0.0, 1.0) * min(width, 1.0);
    pixel = vec4(colour.rgb, colour.a * cover);
  }`;

const DOT_VERTEX = `
  layout(location = 0) in vec2 place;
  uniform mat3 clip_from;
  uniform float size;
  void main() {
    gl_Position = vec4((clip_from * vec3(place, 1.0)).xy, 0.0, 1.0);
    gl_PointSize = size + 1.0;
  }`;

const DOT_FRAGMENT = `
  uniform float size;
  uniform vec4 tint;
  out vec4 pixel;
  void main() {
    float far = length(gl_PointCoord - 0.5) * (size + 1.0);
    pixel = vec4(tint.rgb, tint.a * clamp(size / 2.0 + 0.5 - far, 0.0, 1.0));
  }`;

/** A line is four vertices, each with both its ends and its colour. */
const VERTEX_BYTES = 20;

/** Points and lines on the graphics card [m, map, relative to an anchor]. */
export class Shape {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.buffer = gl.createBuffer();
    this.count = 0;
    this.anchor = [0, 0];
    this.key = null;
  }

  /** @param {ArrayBufferView} data @param {number} count @param {[number, number]} anchor */
  set(data, count, anchor) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.DYNAMIC_DRAW);
    this.count = count;
    this.anchor = anchor;
  }
}

/** Collects lines: two points and a colour each. */
export class LineList {
  /** @param {number} capacity @param {[number, number]} anchor */
  constructor(capacity, anchor) {
    this.data = new ArrayBuffer(4 * capacity * VERTEX_BYTES);
    this.places = new Float32Array(this.data);
    this.inks = new Uint32Array(this.data);
    this.anchor = anchor;
    this.count = 0;
  }

  /** @param {number} ink as of :func:`inkOf` */
  add(ax, ay, bx, by, ink) {
    const { places, inks, anchor } = this;
    const end = 20 * ++this.count;
    for (let at = end - 20; at < end; at += 5) {
      places[at] = ax - anchor[0];
      places[at + 1] = ay - anchor[1];
      places[at + 2] = bx - anchor[0];
      places[at + 3] = by - anchor[1];
      inks[at + 4] = ink;
    }
  }

  /** @param {Shape} shape */
  into(shape) {
    shape.set(new Uint8Array(this.data, 0, 4 * this.count * VERTEX_BYTES), this.count, this.anchor);
  }
}

/** Return a colour as lines hold it. @param {number[]} rgb @param {number} [alpha] 0 to 1 */
export function inkOf([r, g, b], alpha = 1) {
  return ((Math.round(255 * alpha) << 24) | (b << 16) | (g << 8) | r) >>> 0;
}

/** Draws shapes. */
export class Pen {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.lineProgram = new Program(gl, LINE_VERTEX, LINE_FRAGMENT);
    this.dotProgram = new Program(gl, DOT_VERTEX, DOT_FRAGMENT);
    this.vertices = gl.createVertexArray();
    this.quads = new QuadIndices(gl);
  }

  begin(view) {
    const { gl } = this;
    this.view = view;
    this.ratio = view.ratio;
    gl.bindVertexArray(this.vertices);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  end() {
    this.gl.bindVertexArray(null);
    this.gl.disable(this.gl.BLEND);
  }

  /**
   * @param {Shape} shape of lines
   * @param {number} width [CSS px]
   * @param {number[]} tint colours are multiplied by it
   */
  lines(shape, width, tint = [1, 1, 1, 1]) {
    const { gl } = this;
    if (shape.count === 0) return;
    const at = this.lineProgram.use();
    this.place(shape, at);
    gl.uniform2f(at.screen, (this.view.width * this.ratio) / 2, (this.view.height * this.ratio) / 2);
    gl.uniform1f(at.width, width * this.ratio);
    gl.uniform4fv(at.tint, tint);
    gl.bindBuffer(gl.ARRAY_BUFFER, shape.buffer);
    this.attribute(0, 2, gl.FLOAT, false, VERTEX_BYTES, 0);
    this.attribute(1, 2, gl.FLOAT, false, VERTEX_BYTES, 8);
    this.attribute(2, 4, gl.UNSIGNED_BYTE, true, VERTEX_BYTES, 16);
    this.quads.draw(shape.count);
  }

  /**
   * @param {Shape} shape of points
   * @param {number} size [CSS px]
   * @param {number[]} tint
   */
  dots(shape, size, tint) {
    const { gl } = this;
    if (shape.count === 0) return;
    const at = this.dotProgram.use();
    this.place(shape, at);
    gl.uniform1f(at.size, size * this.ratio);
    gl.uniform4fv(at.tint, tint);
    gl.bindBuffer(gl.ARRAY_BUFFER, shape.buffer);
    this.attribute(0, 2, gl.FLOAT, false, 8, 0);
    gl.disableVertexAttribArray(1);
    gl.disableVertexAttribArray(2);
    gl.drawArrays(gl.POINTS, 0, shape.count);
  }

  place(shape, at) {
    this.gl.uniformMatrix3fv(at.clip_from, false, this.view.clipFrom(...shape.anchor));
  }

  attribute(index, size, type, normalized, stride, offset) {
    const { gl } = this;
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, size, type, normalized, stride, offset);
  }
}
