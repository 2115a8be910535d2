// SPDX-License-Identifier: Apache-2.0
/**
 * What is drawn over a map in which a robot is localised: its path, where it may be, the pose that is
 * being given.
 * @module
 */
import { inkOf, LineList, Shape } from "./gl/lines.js";
import { transform } from "./poses.js";

const PATH_PX = 1.8;
const ARROW_PX = 26;
const HEAD_PX = 9;
const DOT_PX = 8;
/** By how much the dot of a sure place is larger [px]. */
const SURE_PX = 8;
const HALO_PX = 4;
const LEAST_ALPHA = 0.55;
/** Points of the path nearer than this on the screen are left out [px]. */
const SEEN_PX = 1.5;

/** Draws with the pen of the overlays. */
export class LocalisationOverlay {
  /** @param {import("./overlays.js").Overlays} overlays */
  constructor(overlays) {
    this.overlays = overlays;
    const { gl } = overlays.pen;
    this.path = new Shape(gl);
    this.arrow = new Shape(gl);
    this.dot = new Shape(gl);
  }

  /** @param {import("./view.js").View} view @param {import("./overlays.js").Scene} scene */
  draw(view, scene) {
    const { state, layers, scan, given } = scene;
    const { map, places } = state.localisation;
    const { inks } = this.overlays.theme;
    if (layers.trajectory) this.drawPath(view, state);
    if (layers.scan && scan) this.overlays.drawScan(scan, map ? 0.9 : LEAST_ALPHA);
    if (layers.candidates) {
      for (const place of [...places].reverse()) {
        const alpha = LEAST_ALPHA + (1 - LEAST_ALPHA) * place.probability;
        this.drawPose(view, place.map, inks.candidate, alpha, DOT_PX + SURE_PX * place.probability);
      }
    }
    if (map) this.overlays.drawRobot(map, view);
    if (given) this.drawPose(view, given, inks.given, 1, DOT_PX);
  }

  drawPath(view, { path, pathVersion }) {
    const { anchor, theme } = this.overlays;
    const apart = SEEN_PX * 2 ** -Math.floor(Math.log2(view.scale));
    const key = [pathVersion, apart, theme.name, anchor].join();
    if (this.path.key !== key) {
      this.path.key = key;
      const lines = new LineList(path.length, anchor);
      const ink = inkOf(theme.inks.trajectory);
      const { rows } = path;
      let [x, y] = [0, 0];
      for (let i = 0; i < rows.length; i += 3) {
        const begins = rows[i + 2] > 0;
        const ends = i + 3 >= rows.length || rows[i + 5] > 0;
        if (!begins && !ends && Math.hypot(rows[i] - x, rows[i + 1] - y) < apart) continue;
        if (!begins) lines.add(x, y, rows[i], rows[i + 1], ink);
        [x, y] = [rows[i], rows[i + 1]];
      }
      lines.into(this.path);
    }
    this.overlays.pen.lines(this.path, PATH_PX);
  }

  /** Draw an arrow from a place to where the robot faces. */
  drawPose(view, pose, rgb, alpha, size) {
    const { anchor, pen, theme } = this.overlays;
    const px = 1 / view.scale;
    const tip = transform(pose, ARROW_PX * px, 0);
    const barbs = [1, -1].map((side) => transform(pose, (ARROW_PX - HEAD_PX) * px, side * 0.7 * HEAD_PX * px));
    for (const [ink, more, opacity] of [[theme.inks.halo, HALO_PX, 0.8], [rgb, 0, alpha]]) {
      const lines = new LineList(3, anchor);
      for (const from of [pose, ...barbs]) lines.add(from[0], from[1], tip[0], tip[1], inkOf(ink, opacity));
      lines.into(this.arrow);
      pen.lines(this.arrow, 3 + more);
      this.dot.set(new Float32Array([pose[0] - anchor[0], pose[1] - anchor[1]]), 1, anchor);
      pen.dots(this.dot, size + more, [...ink.map((value) => value / 255), opacity]);
    }
  }
}
