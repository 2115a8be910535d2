// SPDX-License-Identifier: Apache-2.0
/**
 * All that is drawn by the graphics card, and when.
 * @module
 */
import { poseAt, transform } from "../poses.js";
import { View } from "../view.js";
import { Composer } from "./composer.js";
import { openContext } from "./context.js";
import { MapLayer } from "./map_layer.js";
import { MARGIN, Screen } from "./screen.js";
import { Submaps } from "./submaps.js";
import { TileWork } from "./tile_work.js";
import { Tiles } from "./tiles.js";

const MAX_PIXEL_RATIO = 2;
/** Longest time for which the graphics card composes without a break [ms]. */
const SLICE_MS = 60;
const HANDLED_SLICE_MS = 10;

/**
 * @typedef {object} Picture
 * @property {ArrayLike<number>} poses tf_map_submap as shown
 * @property {(submap: number) => boolean} isShown
 * @property {boolean} gliding whether submaps are on their way, so that no square holds
 * @property {boolean} coarse whether it may be, as the next one comes at once and time is short
 * @property {(view: View) => void} drawGraph what is kept together with the map
 * @property {(view: View) => void} drawNow what is drawn again each time
 */

/** Draws the map, and has others draw over it. */
export class Renderer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {View} view
   * @param {() => void} onNews there is something to compose, or to draw
   * @throws {Error} where the browser cannot
   */
  constructor(canvas, view, onNews) {
    const { gl, formats } = openContext(canvas);
    this.canvas = canvas;
    this.gl = gl;
    this.view = view;
    this.submaps = new Submaps(gl, (submap, box) => {
      if (submap) this.tiles.change(submap, box);
      else if (this.map.hasPreview) this.invalidate();
      onNews();
    });
    this.composer = new Composer(gl, formats);
    this.tiles = new Tiles(gl, this.composer, this.submaps);
    this.work = new TileWork(gl, this.tiles);
    this.screen = new Screen(gl);
    this.map = new MapLayer(gl, this.submaps, this.tiles, this.screen);
    /** What the picture shows that was drawn last: more than the screen, all around. */
    this.drawn = new View();
  }

  /** Something other than the view has changed: all is to be drawn. */
  invalidate() {
    this.screen.invalidate();
  }

  /** What is drawn over the map each time has changed. */
  touch() {
    this.presented = "";
  }

  /** A connection begins. */
  begin(hello) {
    this.submaps.begin(hello);
    this.composer.begin(hello);
    this.tiles.begin();
    this.work.drop();
  }

  /** Whether what is shown is all there is to be seen. */
  get isSettled() {
    if (this.submaps.numPending > 0 || !this.screen.isValid || this.map.isCoarse) return false;
    return !this.map.isFine(this.view) || (this.work.isDone && !this.map.hasPreview);
  }

  /** Fit the picture to the canvas; return whether it has changed. */
  resize() {
    const ratio = Math.min(devicePixelRatio || 1, MAX_PIXEL_RATIO);
    const { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    this.view.resize(clientWidth, clientHeight, ratio);
    if (this.canvas.width === width && this.canvas.height === height) return false;
    this.canvas.width = Math.max(1, width);
    this.canvas.height = Math.max(1, height);
    return true;
  }

  /**
   * Bring the composed map up to date, as far as there is time.
   * @param {ArrayLike<number>} poses tf_map_submap
   * @param {(submap: number) => boolean} isShown
   * @param {boolean} isHandled whether there are hands on the map, that must not wait
   * @returns {boolean} whether there is more to do
   */
  compose(poses, isShown, isHandled) {
    if (this.gl.isContextLost()) return false;
    this.tiles.place(poses, isShown);
    if (!this.map.isFine(this.view)) return false;
    this.tiles.see(this.view.bounds());
    return this.work.advance(isHandled ? HANDLED_SLICE_MS : SLICE_MS);
  }

  /**
   * Draw, as little as is needed.
   * @param {Picture} picture
   * @returns {boolean} whether all was drawn again
   */
  draw(picture) {
    const { gl, screen, view, drawn } = this;
    if (gl.isContextLost()) return false;
    screen.resize();
    let offset = this.offset(picture);
    const isAll = offset === null;
    if (isAll) {
      drawn.copy(view);
      drawn.resize(screen.width / view.ratio, screen.height / view.ratio, view.ratio);
      this.map.begin();
      this.paint(picture, [picture.coarse ? screen.window : screen.all]);
    } else if (!screen.holds(offset)) {
      const [dx, dy] = [MARGIN - offset[0], MARGIN - offset[1]];
      drawn.panBy(dx / view.ratio, -dy / view.ratio);
      this.paint({ ...picture, coarse: false }, screen.move(dx, dy));
    } else if (offset.join() === this.presented) {
      return false;
    }
    offset = this.offset(picture) ?? [MARGIN, MARGIN];
    this.presented = offset.join();
    screen.present(offset);
    picture.drawNow(view);
    return isAll;
  }

  /** Draw parts of the picture again; the rest of what was drawn stays. */
  paint(picture, rects) {
    const { gl, screen, drawn } = this;
    gl.enable(gl.SCISSOR_TEST);
    for (const rect of rects) {
      gl.scissor(...rect);
      this.map.draw(drawn, picture, rect);
      gl.bindFramebuffer(gl.FRAMEBUFFER, screen.target);
      picture.drawGraph(drawn);
    }
    gl.disable(gl.SCISSOR_TEST);
    screen.valid = picture.coarse ? rects[0] : screen.all;
    this.presented = "";
  }

  /**
   * Return where in the picture that was drawn last the view is, null if it must be drawn again.
   * @param {Picture} picture
   * @returns {[number, number] | null} [device px]
   */
  offset({ gliding }) {
    const { screen, view, drawn } = this;
    const isSame = view.scale === drawn.scale && view.rotation === drawn.rotation
      && view.ratio === drawn.ratio;
    if (!screen.isValid || !isSame || gliding) return null;
    const [x, y] = drawn.toScreen(view.x, view.y);
    return [Math.round((x - view.width / 2) * view.ratio),
      Math.round(screen.height - (y + view.height / 2) * view.ratio)];
  }

  /** Call back when all that was asked for is on the screen. @param {() => void} callback */
  whenDrawn(callback) {
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (gl.isContextLost()) return;
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
        setTimeout(look, 4);
      } else {
        gl.deleteSync(fence);
        callback();
      }
    };
    look();
  }

  /**
   * Return where the map is: what is known as a whole, not where single rays went astray.
   * @param {ArrayLike<number>} poses tf_map_submap
   * @returns {import("../view.js").Bounds | null}
   */
  bounds(poses) {
    const [xs, ys] = [[], []];
    const known = [...this.submaps.previews].filter(([id]) => 3 * id + 2 < poses.length);
    const dense = known.filter(([, preview]) => preview.dense);
    for (const [id, { x, y, resolution, ...all }] of dense.length > 0 ? dense : known) {
      const { row: low = 0, col: left = 0, rows, cols } = all.dense ?? all;
      for (const col of [left, left + cols - 1]) {
        for (const row of [low, low + rows - 1]) {
          const at = transform(poseAt(poses, id), x + col * resolution, y + row * resolution);
          xs.push(at[0]);
          ys.push(at[1]);
        }
      }
    }
    if (xs.length === 0) return null;
    return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
  }
}
