// SPDX-License-Identifier: Apache-2.0
/**
 * Adds up the evidence of submaps over a square of the map's cells, as the exported map does it.
 * @module
 */
import { BLOCK, MARGIN } from "../cells.js";
import { shadesOf } from "../shades.js";
import { CORNER, createTarget, createTexture, Program, QuadIndices } from "./context.js";

/** Edge of the square, cells. */
export const TILE = 512;

// Corners of runs of blocks reach half a cell further than the centres of their outermost cells: there a
// cell of the block is the nearest one.
const ADD_VERTEX = `
  layout(location = 0) in vec2 corner;
  uniform vec2 size;
  uniform mat3 tf_tile_cells;
  void main() {
    vec2 cell = min(corner * ${BLOCK}.0, size) - 0.5;
    vec2 tile = (tf_tile_cells * vec3(cell, 1.0)).xy;
    gl_Position = vec4(tile / ${TILE / 2}.0 - 1.0, 0.0, 1.0);
  }`;

const ADD_FRAGMENT = `
  precision highp usampler2D;
  uniform usampler2D cells;
  uniform mat3 tf_cells_tile;
  uniform ivec2 last;
  uniform vec4 log_odds[64];
  out vec4 sum;
  float evidence(uint cell) { return log_odds[cell >> 2][cell & 3u]; }
  void main() {
    vec2 cell = (tf_cells_tile * vec3(gl_FragCoord.xy, 1.0)).xy;
    vec2 low = floor(cell);
    vec2 part = cell - low;
    ivec2 at = clamp(ivec2(low) + ivec2(${MARGIN}, 1), ivec2(0), last);
    uint a = texelFetch(cells, at, 0).r;
    uint b = texelFetch(cells, at + ivec2(1, 0), 0).r;
    uint c = texelFetch(cells, at + ivec2(0, 1), 0).r;
    uint d = texelFetch(cells, at + ivec2(1, 1), 0).r;
    uint nearest = part.y < 0.5 ? (part.x < 0.5 ? a : b) : (part.x < 0.5 ? c : d);
    if (nearest == 0u) discard;
    vec2 across = mix(vec2(evidence(a), evidence(c)), vec2(evidence(b), evidence(d)), part.x);
    sum = vec4(mix(across.x, across.y, part.y), 1.0, 0.0, 0.0);
  }`;

const ALL_VERTEX = `
  ${CORNER}
  void main() { gl_Position = vec4(2.0 * corner() - 1.0, 0.0, 1.0); }`;

// What is shown of each level: how much floor and how much wall. The level itself is for measuring.
const LEVEL_FRAGMENT = `
  uniform sampler2D sums;
  uniform sampler2D shades;
  uniform float max_log_odds;
  out vec4 shown;
  void main() {
    vec2 sum = texelFetch(sums, ivec2(gl_FragCoord.xy), 0).rg;
    float odds = clamp(sum.r, -max_log_odds, max_log_odds);
    float level = floor(255.0 / (1.0 + exp(-odds)) + 0.5);
    vec2 shade = texelFetch(shades, ivec2(level, 0), 0).rg;
    shown = sum.g > 0.0 ? vec4(shade, level / 255.0, 1.0) : vec4(0.0);
  }`;

/** Draws into one square at a time. */
export class Composer {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./context.js").Formats} formats
   */
  constructor(gl, formats) {
    this.gl = gl;
    this.addProgram = new Program(gl, ADD_VERTEX, ADD_FRAGMENT);
    this.levelProgram = new Program(gl, ALL_VERTEX, LEVEL_FRAGMENT);
    this.sums = createTexture(gl, formats.sums, TILE, TILE);
    this.target = createTarget(gl, this.sums);
    this.shades = createTexture(gl, gl.RG8, 256, 1);
    this.vertices = gl.createVertexArray();
    this.empty = gl.createVertexArray();
    this.corners = gl.createBuffer();
    this.quads = new QuadIndices(gl);
    this.resolution = 0.05;
  }

  /** @param {{log_odds: number[], max_log_odds: number, resolution: number, palette: number[][]}} hello */
  begin(hello) {
    const { gl } = this;
    this.resolution = hello.resolution;
    const at = this.addProgram.use();
    const evidence = Float32Array.from(hello.log_odds);
    evidence[0] = 0; // unknown adds nothing to its neighbours
    gl.uniform4fv(at.log_odds, evidence);
    const level = this.levelProgram.use();
    gl.uniform1f(level.max_log_odds, hello.max_log_odds);
    gl.uniform1i(level.sums, 0);
    gl.uniform1i(level.shades, 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.shades);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RG, gl.UNSIGNED_BYTE,
      shadesOf(hello.palette));
    gl.activeTexture(gl.TEXTURE0);
  }

  /**
   * Start again within a box.
   * @param {[number, number]} origin of the square, cells of the map
   * @param {[number, number, number, number]} box left, bottom, right, top within the square
   */
  clear(origin, box) {
    const { gl } = this;
    this.origin = origin;
    this.box = box;
    this.bind(this.target);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.disable(gl.SCISSOR_TEST);
  }

  bind(target) {
    const { gl, box } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, TILE, TILE);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(box[0], box[1], box[2] - box[0], box[3] - box[1]);
  }

  /**
   * Add submaps.
   * @param {Array<[import("./submaps.js").Submap, import("../poses.js").Pose]>} submaps with
   *   tf_map_submap
   */
  add(submaps) {
    const { gl } = this;
    const at = this.addProgram.use();
    this.bind(this.target);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    gl.bindVertexArray(this.vertices);
    gl.enableVertexAttribArray(0);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.vertexAttribPointer(0, 2, gl.UNSIGNED_SHORT, false, 0, 0);
    gl.activeTexture(gl.TEXTURE0);
    for (const [submap, pose] of submaps) {
      const [forth, back] = this.transforms(submap, pose);
      const corners = this.cornersWithin(submap, forth);
      if (corners.length === 0) continue;
      gl.uniform2f(at.size, submap.cols, submap.rows);
      gl.uniform2i(at.last, submap.cols + MARGIN - 1, submap.rows);
      gl.uniformMatrix3fv(at.tf_tile_cells, false, forth);
      gl.uniformMatrix3fv(at.tf_cells_tile, false, back);
      gl.bindTexture(gl.TEXTURE_2D, submap.cells);
      gl.bufferData(gl.ARRAY_BUFFER, corners, gl.STREAM_DRAW);
      this.quads.draw(corners.length / 8);
    }
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
  }

  /**
   * Return the corners of the runs of blocks that reach into the box, in blocks.
   * @returns {Uint16Array}
   */
  cornersWithin({ spans }, forth) {
    const found = [];
    const [left, bottom, right, top] = this.box;
    const reachX = BLOCK * Math.max(Math.abs(forth[0]), Math.abs(forth[3]), 1) + 2;
    for (let at = 0; at < spans.length; at += 3) {
      const row = spans[at];
      let [begin, end] = [spans[at + 1], spans[at + 2]];
      // Of a run, only the blocks whose centres are near the box.
      const isNear = (col) => {
        const [u, v] = [(col + 0.5) * BLOCK, (row + 0.5) * BLOCK];
        const x = forth[0] * u + forth[3] * v + forth[6];
        const y = forth[1] * u + forth[4] * v + forth[7];
        return x > left - reachX && x < right + reachX && y > bottom - reachX && y < top + reachX;
      };
      while (begin < end && !isNear(begin)) begin++;
      while (end > begin && !isNear(end - 1)) end--;
      if (begin < end) found.push(begin, row, end, row, begin, row + 1, end, row + 1);
    }
    return new Uint16Array(found);
  }

  /**
   * Return tf_tile_cells and tf_cells_tile, by column. Computed in double: far from the origin of
   * the map, single precision would be a millimetre.
   */
  transforms({ x, y, resolution }, [tx, ty, theta]) {
    const [left, bottom] = this.origin;
    const cos = Math.cos(theta);
    const sin = Math.sin(theta);
    const zoom = resolution / this.resolution;
    const forth = [zoom * cos, zoom * sin, 0, -zoom * sin, zoom * cos, 0,
      (tx + cos * x - sin * y) / this.resolution - left,
      (ty + sin * x + cos * y) / this.resolution - bottom, 1];
    const [dx, dy] = [left * this.resolution - tx, bottom * this.resolution - ty];
    const back = [cos / zoom, -sin / zoom, 0, sin / zoom, cos / zoom, 0,
      (cos * dx + sin * dy - x) / resolution, (cos * dy - sin * dx - y) / resolution, 1];
    return [forth, back];
  }

  /**
   * Draw what the sums mean into a texture: how much floor, how much wall, the probability, and
   * whether it is known.
   * @param {WebGLFramebuffer} target
   */
  finish(target) {
    const { gl } = this;
    this.levelProgram.use();
    this.bind(target);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.shades);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.sums);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
    gl.disable(gl.SCISSOR_TEST);
  }
}
