// SPDX-License-Identifier: Apache-2.0
/**
 * The camera: which part of the map is on the screen.
 * Screen coordinates are CSS pixels from the top left corner, y downwards.
 * @module
 */

const MIN_SCALE = 0.2;
const MAX_SCALE = 2000;
/** Nothing is magnified more than that to fill the screen. */
const MAX_FIT_SCALE = 120;

/** Whatever covers the screen, something is made to fit in so much of it [px]. */
const LEAST_FREE_PX = 40;

/** @typedef {{left: number, bottom: number, right: number, top: number}} Bounds [m, map] */
/** @typedef {{top: number, right: number, bottom: number, left: number}} Insets [px] */

/** The camera. */
export class View {
  constructor() {
    /** What is in the middle of the screen [m, map]. */
    this.x = 0;
    this.y = 0;
    /** Pixels a metre. */
    this.scale = 20;
    /** By how much the map is turned counter-clockwise [rad]. */
    this.rotation = 0;
    this.width = 1;
    this.height = 1;
    /** Hands zoom out no farther [pixels a metre]. */
    this.minScale = MIN_SCALE;
    /** Pixels of the device for each CSS pixel. */
    this.ratio = 1;
  }

  resize(width, height, ratio) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.ratio = ratio;
  }

  /** Become the same as another. @param {View} other */
  copy(other) {
    Object.assign(this, other);
  }

  /** Return where a point of the map is on the screen. @returns {[number, number]} */
  toScreen(x, y) {
    const cos = Math.cos(this.rotation) * this.scale;
    const sin = Math.sin(this.rotation) * this.scale;
    const [dx, dy] = [x - this.x, y - this.y];
    return [this.width / 2 + cos * dx - sin * dy, this.height / 2 - (sin * dx + cos * dy)];
  }

  /** Return which point of the map is there on the screen. @returns {[number, number]} */
  toMap(px, py) {
    const cos = Math.cos(this.rotation) / this.scale;
    const sin = Math.sin(this.rotation) / this.scale;
    const [dx, dy] = [px - this.width / 2, this.height / 2 - py];
    return [this.x + cos * dx + sin * dy, this.y - sin * dx + cos * dy];
  }

  panBy(dx, dy) {
    [this.x, this.y] = this.toMap(this.width / 2 - dx, this.height / 2 - dy);
  }

  /** Zoom and turn, what is under a point of the screen staying where it is. */
  change(px, py, factor, turn = 0) {
    const [x, y] = this.toMap(px, py);
    const least = Math.min(this.minScale, this.scale);
    this.scale = Math.min(Math.max(this.scale * factor, least), MAX_SCALE);
    this.rotation += turn;
    this.pin(x, y, px, py);
  }

  /** Bring a point of the map to a point of the screen. */
  pin(x, y, px, py) {
    const [nowX, nowY] = this.toMap(px, py);
    this.x += x - nowX;
    this.y += y - nowY;
  }

  /**
   * Show all of something, beside what covers the screen.
   * @param {Bounds} bounds
   * @param {Insets} insets
   * @param {number} filled share of the rest that it fills
   */
  fit(bounds, insets, filled) {
    const scale = filled * this.fittingScale(bounds, insets);
    this.scale = Math.max(scale, MIN_SCALE);
    this.pin((bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2,
      (insets.left + this.width - insets.right) / 2, (insets.top + this.height - insets.bottom) / 2);
  }

  /** Return the scale at which something fills the screen, beside what covers it. */
  fittingScale(bounds, insets) {
    const width = Math.max(this.width - insets.left - insets.right, LEAST_FREE_PX);
    const height = Math.max(this.height - insets.top - insets.bottom, LEAST_FREE_PX);
    const cos = Math.abs(Math.cos(this.rotation));
    const sin = Math.abs(Math.sin(this.rotation));
    const [w, h] = [bounds.right - bounds.left, bounds.top - bounds.bottom];
    return Math.min(width / (cos * w + sin * h), height / (sin * w + cos * h), MAX_FIT_SCALE);
  }

  /** Return whether all of something is on the screen, beside what covers it. */
  holds({ left, bottom, right, top }, insets) {
    return [[left, bottom], [right, bottom], [left, top], [right, top]].every(([x, y]) => {
      const [px, py] = this.toScreen(x, y);
      return px >= insets.left && px <= this.width - insets.right && py >= insets.top
        && py <= this.height - insets.bottom;
    });
  }

  /** Return whether anything of a part of the map may be on the screen. */
  touches({ left, bottom, right, top }) {
    const seen = this.bounds();
    return left < seen.right && right > seen.left && bottom < seen.top && top > seen.bottom;
  }

  /** Return what is needed to come back, as text. */
  toText() {
    return [this.x.toFixed(3), this.y.toFixed(3), this.scale.toFixed(3),
      ((this.rotation * 180) / Math.PI).toFixed(2)].join(",");
  }

  /** Come back; return whether the text held a view. */
  fromText(text) {
    const numbers = (text ?? "").split(",").map(Number);
    if (numbers.length !== 4 || !numbers.every(Number.isFinite) || numbers[2] <= 0) return false;
    [this.x, this.y] = numbers;
    this.scale = Math.min(Math.max(numbers[2], MIN_SCALE), MAX_SCALE);
    this.rotation = (numbers[3] * Math.PI) / 180;
    return true;
  }

  /** Return the matrix, by column, from metres relative to a point of the map to clip space. */
  clipFrom(x, y) {
    const cos = Math.cos(this.rotation) * this.scale;
    const sin = Math.sin(this.rotation) * this.scale;
    const [w, h] = [2 / this.width, 2 / this.height];
    const [dx, dy] = [x - this.x, y - this.y];
    return [cos * w, sin * h, 0, -sin * w, cos * h, 0, (cos * dx - sin * dy) * w,
      (sin * dx + cos * dy) * h, 1];
  }

  /** Return what of the map is on the screen. @returns {Bounds} */
  bounds() {
    const corners = [[0, 0], [this.width, 0], [0, this.height], [this.width, this.height]]
      .map(([px, py]) => this.toMap(px, py));
    const [xs, ys] = [corners.map(([x]) => x), corners.map(([, y]) => y)];
    return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
  }
}
