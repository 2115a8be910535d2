// SPDX-License-Identifier: Apache-2.0
/**
 * WebGL 2: the context, programs and the few kinds of textures that there are.
 * @module
 */

/**
 * @typedef {object} Formats of what sums of evidence are kept in
 * @property {number} sums internal format of textures of two floats that can be added to
 */

/**
 * Return a context that can add up floats, and how.
 * @param {HTMLCanvasElement} canvas
 * @returns {{gl: WebGL2RenderingContext, formats: Formats}}
 * @throws {Error} in words for the operator, where this browser cannot
 */
export function openContext(canvas) {
  const gl = canvas.getContext("webgl2", {
    alpha: false, antialias: false, depth: false, stencil: false,
    powerPreference: "high-performance",
  });
  if (!gl) throw new Error("This browser does not offer WebGL 2, which the map is drawn with. "
    + "Update it, or allow it to use the graphics card.");
  const float = gl.getExtension("EXT_color_buffer_float");
  const half = float ?? gl.getExtension("EXT_color_buffer_half_float");
  if (!half) throw new Error("The graphics of this device cannot add up numbers with fractions.");
  const sums = float && gl.getExtension("EXT_float_blend") ? gl.RG32F : gl.RG16F;
  return { gl, formats: { sums } };
}

/** A linked program, and where its uniforms are. */
export class Program {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {string} vertex source, without its version
   * @param {string} fragment
   */
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, `#version 300 es\nprecision highp float;\nprecision highp int;\n${source}`);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
      gl.deleteShader(shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const [vs, fs] = gl.getAttachedShaders(this.program);
      const log = [gl.getProgramInfoLog(this.program), gl.getShaderInfoLog(vs), gl.getShaderInfoLog(fs)];
      throw new Error(`A program of the graphics card is refused: ${log.join(" ")}`);
    }
    /** @type {Record<string, WebGLUniformLocation>} */
    this.at = {};
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS) ?? 0;
    for (let i = 0; i < count; i++) {
      const name = gl.getActiveUniform(this.program, i).name.replace("[0]", "");
      this.at[name] = gl.getUniformLocation(this.program, name);
    }
  }

  use() {
    this.gl.useProgram(this.program);
    return this.at;
  }
}

/**
 * Return a texture that is clamped at its edges, with room for its pixels.
 * @param {WebGL2RenderingContext} gl
 * @param {number} format internal
 * @param {number} width
 * @param {number} height
 * @param {object} [options]
 * @param {number} [options.levels] of the mipmap
 * @param {number} [options.min] filter
 * @param {number} [options.mag]
 */
export function createTexture(gl, format, width, height, { levels = 1, min, mag } = {}) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, levels, format, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, min ?? gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, mag ?? gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return texture;
}

/** Return a framebuffer that draws into a texture. */
export function createTarget(gl, texture) {
  const target = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  return target;
}

/**
 * Quads of four corners each: 0 1 2 and 2 1 3. Many instances of one quad would be as easy, but take
 * ten times as long where there is no graphics card.
 */
export class QuadIndices {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.buffer = gl.createBuffer();
    this.count = 0;
  }

  /** Draw a number of quads of the bound vertices. */
  draw(count) {
    const { gl } = this;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffer);
    if (count > this.count) this.grow(Math.max(2 * this.count, count, 1024));
    gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
  }

  grow(count) {
    const indices = new Uint32Array(6 * count);
    for (let quad = 0; quad < count; quad++) {
      [0, 1, 2, 2, 1, 3].forEach((corner, i) => {
        indices[6 * quad + i] = 4 * quad + corner;
      });
    }
    this.gl.bufferData(this.gl.ELEMENT_ARRAY_BUFFER, indices, this.gl.STATIC_DRAW);
    this.count = count;
  }
}

/** How many levels the mipmap of a texture has. */
export function mipLevels(width, height) {
  return Math.floor(Math.log2(Math.max(width, height, 1))) + 1;
}

/** Corners of unit squares, four vertices each: from gl_VertexID alone. */
export const CORNER = "vec2 corner() { return vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1); }";
