// SPDX-License-Identifier: Apache-2.0
/**
 * The map on the screen: squares that are composed of all cells, and beneath them, where they are not
 * yet, submaps are gliding, or cells are too small to be seen, previews of the submaps.
 * @module
 */
import { poseAt } from "../poses.js";
import { TILE } from "./composer.js";
import { CORNER, createTarget, createTexture, Program } from "./context.js";
import { originOf, RIM, STRIDE } from "./tiles.js";

/** Where cells are smaller on the screen, previews show as much [device px]. */
const SEEN_CELL_PX = 0.5;
/** While the picture moves, previews are added up at a fraction of the screen's resolution. */
const COARSE = 2;
/** Pixels at the edge of a part may need what lies so far beyond it. */
const EDGE_PX = 4;

// Walls are thin: seen from afar, a mean of colours would pale them.
const COLOUR = `
  uniform vec3 ground;
  uniform vec3 floor_colour;
  uniform vec3 wall_colour;
  uniform float boost;
  vec4 colour(float floor_share, float wall_share) {
    float wall = min(1.0, wall_share * boost);
    float rest = min(floor_share, 1.0 - wall);
    return vec4(ground + rest * (floor_colour - ground) + wall * (wall_colour - ground), 1.0);
  }`;

const TILE_VERTEX = `
  uniform mat3 clip_from;
  uniform vec2 edge;
  out vec2 at;
  ${CORNER}
  void main() {
    at = (${RIM}.0 + corner() * ${STRIDE}.0) / ${TILE}.0;
    gl_Position = vec4((clip_from * vec3(corner() * edge, 1.0)).xy, 0.0, 1.0);
  }`;

const TILE_FRAGMENT = `
  uniform sampler2D tile;
  in vec2 at;
  out vec4 pixel;
  ${COLOUR}
  void main() {
    vec2 shade = texture(tile, at, -0.25).rg;
    pixel = colour(shade.r, shade.g);
  }`;

const PREVIEW_VERTEX = `
  uniform mat3 clip_from;
  uniform vec2 edge;
  out vec2 at;
  ${CORNER}
  void main() {
    at = corner();
    gl_Position = vec4((clip_from * vec3(corner() * edge, 1.0)).xy, 0.0, 1.0);
  }`;

const PREVIEW_FRAGMENT = `
  uniform sampler2D preview;
  in vec2 at;
  out vec4 sum;
  void main() { sum = vec4(texture(preview, at, -1.0).rgb, 0.0); }`;

const SHOW_VERTEX = `
  uniform vec2 share;
  out vec2 at;
  ${CORNER}
  void main() { at = share * corner(); gl_Position = vec4(2.0 * corner() - 1.0, 0.0, 1.0); }`;

// What submaps disagree on is their mean.
const SHOW_FRAGMENT = `
  uniform sampler2D sums;
  in vec2 at;
  out vec4 pixel;
  ${COLOUR}
  void main() {
    vec3 sum = texture(sums, at).rgb;
    vec2 shade = sum.rg / max(sum.b, 1.0);
    pixel = colour(shade.r, shade.g);
  }`;

/** Draws the map. */
export class MapLayer {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./submaps.js").Submaps} submaps
   * @param {import("./tiles.js").Tiles} tiles
   * @param {import("./screen.js").Screen} screen that is drawn into
   */
  constructor(gl, submaps, tiles, screen) {
    this.gl = gl;
    this.submaps = submaps;
    this.tiles = tiles;
    this.screen = screen;
    this.tileProgram = new Program(gl, TILE_VERTEX, TILE_FRAGMENT);
    this.previewProgram = new Program(gl, PREVIEW_VERTEX, PREVIEW_FRAGMENT);
    this.showProgram = new Program(gl, SHOW_VERTEX, SHOW_FRAGMENT);
    this.vertices = gl.createVertexArray();
    this.width = this.height = 0;
    /** Whether the last picture was in part made of previews. */
    this.hasPreview = false;
    /** Whether these were coarse, as they moved. */
    this.isCoarse = false;
    /** Set before anything is drawn. @type {import("../shades.js").MapColours} */
    this.colours = null;
  }

  /** How large a cell is on the screen [device px]. */
  cellPixels(view) {
    return view.ratio * view.scale * this.tiles.composer.resolution;
  }

  /** Whether single cells can be seen. @param {import("../view.js").View} view */
  isFine(view) {
    return this.cellPixels(view) >= SEEN_CELL_PX;
  }

  /** Begin a new picture. */
  begin() {
    this.hasPreview = this.isCoarse = false;
  }

  /**
   * Draw the map, or part of it.
   * @param {import("../view.js").View} view
   * @param {import("./renderer.js").Picture} picture
   * @param {import("./screen.js").Rect} rect of the screen that is to be drawn
   */
  draw(view, picture, rect) {
    const { gl } = this;
    const visible = picture.gliding || !this.isFine(view) ? null : this.tiles.within(view.bounds());
    const ready = visible?.filter(isReady) ?? [];
    gl.bindVertexArray(this.vertices);
    gl.disable(gl.BLEND);
    if (ready.length < (visible?.length ?? 1)) {
      this.drawPreviews(view, picture, rect);
    } else {
      this.bindScreen();
      gl.clearColor(...this.colours.ground.map((value) => value / 255), 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }
    this.drawTiles(view, ready);
    gl.bindVertexArray(null);
  }

  bindScreen() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.screen.target);
    gl.viewport(0, 0, this.screen.width, this.screen.height);
  }

  setColours(at, view) {
    const { gl } = this;
    const { ground, floor, wall } = this.colours;
    gl.uniform3fv(at.ground, ground.map((value) => value / 255));
    gl.uniform3fv(at.floor_colour, floor.map((value) => value / 255));
    gl.uniform3fv(at.wall_colour, wall.map((value) => value / 255));
    gl.uniform1f(at.boost, Math.min(Math.max(1, 0.9 / this.cellPixels(view)), 2.2));
  }

  drawTiles(view, ready) {
    const { gl } = this;
    const at = this.tileProgram.use();
    this.setColours(at, view);
    this.bindScreen();
    const edge = this.tiles.composer.resolution;
    gl.uniform2f(at.edge, STRIDE * edge, STRIDE * edge);
    gl.activeTexture(gl.TEXTURE0);
    for (const tile of ready) {
      const [left, bottom] = originOf(tile);
      const clip = view.clipFrom((left + RIM) * edge, (bottom + RIM) * edge);
      gl.uniformMatrix3fv(at.clip_from, false, clip);
      gl.bindTexture(gl.TEXTURE_2D, tile.texture);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
  }

  drawPreviews(view, { poses, isShown, coarse }, rect) {
    const { gl } = this;
    const factor = coarse ? COARSE : 1;
    this.hasPreview = true;
    this.isCoarse ||= coarse;
    this.resizeSums();
    const [width, height] = [Math.ceil(this.width / factor), Math.ceil(this.height / factor)];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, width, height);
    gl.scissor(...scaledDown(rect, factor));
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    const at = this.previewProgram.use();
    gl.activeTexture(gl.TEXTURE0);
    for (const [id, preview] of this.submaps.previews) {
      if (3 * id + 2 >= poses.length || !isShown(id)) continue;
      const clip = clipFromCells(view, preview, poseAt(poses, id));
      if (!isWithin(clip, preview, rect, this)) continue;
      gl.uniformMatrix3fv(at.clip_from, false, clip);
      gl.uniform2f(at.edge, preview.cols, preview.rows);
      gl.bindTexture(gl.TEXTURE_2D, preview.texture);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.disable(gl.BLEND);
    const show = this.showProgram.use();
    this.setColours(show, view);
    gl.uniform2f(show.share, width / this.width, height / this.height);
    this.bindScreen();
    gl.scissor(...rect);
    gl.bindTexture(gl.TEXTURE_2D, this.sums);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  resizeSums() {
    const { gl } = this;
    const { width, height } = this.screen;
    if (width === this.width && height === this.height) return;
    gl.deleteTexture(this.sums);
    gl.deleteFramebuffer(this.target);
    this.sums = createTexture(gl, gl.RGBA16F, width, height, { min: gl.LINEAR, mag: gl.LINEAR });
    this.target = createTarget(gl, this.sums);
    [this.width, this.height] = [width, height];
  }
}

/** Return what of a smaller picture a part of the screen needs. */
function scaledDown([left, bottom, width, height], factor) {
  const low = [left, bottom].map((at) => Math.floor(at / factor) - 1);
  const high = [left + width, bottom + height].map((at) => Math.ceil(at / factor) + 1);
  return [...low, high[0] - low[0], high[1] - low[1]];
}

/** Return whether anything of a preview is in a part of the screen of that size. */
function isWithin(clip, { cols, rows }, [left, bottom, width, height], screen) {
  const corners = [[0, 0], [cols, 0], [0, rows], [cols, rows]];
  const xs = corners.map(([u, v]) => ((clip[0] * u + clip[3] * v + clip[6] + 1) * screen.width) / 2);
  const ys = corners.map(([u, v]) => ((clip[1] * u + clip[4] * v + clip[7] + 1) * screen.height) / 2);
  return Math.max(...xs) >= left - EDGE_PX && Math.min(...xs) <= left + width + EDGE_PX
    && Math.max(...ys) >= bottom - EDGE_PX && Math.min(...ys) <= bottom + height + EDGE_PX;
}

function isReady(tile) {
  return tile.texture !== null && !tile.stale;
}

/** Return the matrix from pixels of a preview, counted from the corner of the first, to clip space. */
function clipFromCells(view, { x, y, resolution }, [tx, ty, theta]) {
  const clip = view.clipFrom(tx, ty);
  const cos = Math.cos(theta) * resolution;
  const sin = Math.sin(theta) * resolution;
  const [ox, oy] = [x / resolution - 0.5, y / resolution - 0.5];
  const place = [cos, sin, -sin, cos, cos * ox - sin * oy, sin * ox + cos * oy];
  const column = (a, b, w) => [clip[0] * a + clip[3] * b + clip[6] * w,
    clip[1] * a + clip[4] * b + clip[7] * w, w];
  return [...column(place[0], place[1], 0), ...column(place[2], place[3], 0),
    ...column(place[4], place[5], 1)];
}
