// SPDX-License-Identifier: Apache-2.0
/**
 * What is drawn over the map: the way, the scan, nodes, constraints, closures.
 * @module
 */
import { inkOf, LineList, Pen, Shape } from "./gl/lines.js";
import { gridLines, gridStep } from "./grid.js";
import { LocalisationOverlay } from "./localisation_overlay.js";
import { chain, poseAt, transform } from "./poses.js";
import { Kind } from "./protocol.js";
import { beginOf, residualOf } from "./residual.js";
import { sessionInk, sessionsOf } from "./sessions.js";

/** Layers, and whether they are on at first. */
export const LAYERS = Object.freeze({
  trajectory: true, ends: true, scan: true, nodes: false, suspects: true, closures: true,
  constraints: false, latest: true, quality: true, candidates: true, grid: false,
});

/** Distances on the screen below which points are left out [px]; at most twice that. */
const SEEN_PX = 1.5;
/** Single precision is kept relative to the next point of a grid so wide [m]. */
const ANCHOR_M = 64;
const WAY_PX = 1.8;
const ROBOT_PX = 15;
const FADED = 0.3;
const CIRCLE_SIDES = 64;
const END_PX = 12;
const HALO_PX = 4;
/** Inks of places by their severity; minor ones are in the list alone. */
const PLACE_INKS = Object.freeze({ doubtful: "doubtful", wrong: "wrong" });

/**
 * @typedef {object} Scene what is to be drawn
 * @property {import("./state.js").MapState} state
 * @property {import("./motion.js").Motion} motion
 * @property {Record<string, boolean>} layers
 * @property {"kind" | "residual"} colouring of constraints
 * @property {number} numNodes number of nodes that are shown
 * @property {import("./protocol.js").Scan | null} scan
 * @property {object | null} closure that is looked at
 * @property {object | null} latest that was found
 * @property {import("./suspects.js").Suspects} suspects
 * @property {boolean} isBefore whether the poses are those before loop closure
 * @property {boolean} isOver whether the map grows no more, and no other time is shown
 * @property {import("./poses.js").Pose | null} given pose that is being given by hand
 * @property {number} pulse of the latest closure, from 1 to 0
 */

/** Draws over the map. */
export class Overlays {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./theme.js").Theme} theme
   */
  constructor(gl, theme) {
    this.theme = theme;
    this.pen = new Pen(gl);
    this.way = new Shape(gl);
    this.nodes = new Shape(gl);
    this.tail = new Shape(gl);
    this.returns = new Shape(gl);
    this.constraints = new Shape(gl);
    this.frame = new Shape(gl);
    this.dots = new Shape(gl);
    this.places = new Shape(gl);
    this.grid = new Shape(gl);
    this.localisation = new LocalisationOverlay(this);
  }

  /**
   * Draw what stays where it is as long as the map does.
   * @param {import("./view.js").View} view
   * @param {Scene} scene
   */
  drawGraph(view, scene) {
    this.begin(view);
    const { layers } = scene;
    const apart = SEEN_PX * 2 ** -Math.floor(Math.log2(view.scale));
    if (layers.grid) this.drawGrid(view);
    this.setWay(scene, apart);
    if (layers.closures || layers.suspects || layers.constraints) {
      this.setConstraints(scene, apart);
      // One that is looked at must stand out.
      this.pen.lines(this.constraints, 1.2, scene.closure ? [1, 1, 1, FADED] : undefined);
    }
    if (layers.trajectory) this.pen.lines(this.way, WAY_PX);
    if (layers.nodes) this.pen.dots(this.nodes, 4.5, tint(this.theme.inks.node, 0.9));
    if (layers.quality && scene.state.quality && !scene.isBefore) this.drawPlaces(scene.state.quality.places);
    this.pen.end();
  }

  /**
   * Draw what changes with each scan: the robot, what it sees, the closure of interest.
   * @param {import("./view.js").View} view
   * @param {Scene} scene
   */
  drawNow(view, scene) {
    this.begin(view);
    const { layers, scan } = scene;
    if (scene.state.localisation) {
      this.localisation.draw(view, scene);
      this.pen.end();
      return;
    }
    if (layers.trajectory && scan) this.drawTail(scene);
    if (layers.latest && scene.latest && !scene.closure) this.drawClosure(scene.latest, scene);
    if (layers.scan && scan) this.drawScan(scan);
    if (scene.closure) this.drawClosure(scene.closure, scene);
    if (layers.ends) this.drawEnds(scene);
    if (scan && !scene.isOver) this.drawRobot(scan.pose, view);
    this.pen.end();
  }

  drawGrid(view) {
    const bounds = view.bounds();
    const lines = gridLines(bounds, gridStep(view));
    const list = new LineList(lines.length, this.anchor);
    for (const { x, y, strong } of lines) {
      const ink = inkOf(this.theme.inks.grid, strong ? 0.42 : 0.18);
      if (y === null) list.add(x, bounds.bottom, x, bounds.top, ink);
      else list.add(bounds.left, y, bounds.right, y, ink);
    }
    list.into(this.grid);
    this.pen.lines(this.grid, 1);
  }

  /** Draw where the way begins, and where it ends once it does. */
  drawEnds(scene) {
    const { inks } = this.theme;
    for (const { name, at } of endsOf(scene)) {
      this.dots.set(new Float32Array([at[0] - this.anchor[0], at[1] - this.anchor[1]]), 1, this.anchor);
      this.pen.dots(this.dots, END_PX + HALO_PX, tint(inks.halo, 1));
      this.pen.dots(this.dots, END_PX, tint(inks[name], 1));
    }
  }

  begin(view) {
    this.anchor = [view.x, view.y].map((at) => ANCHOR_M * Math.round(at / ANCHOR_M));
    this.pen.begin(view);
  }

  /**
   * Bring trajectory and nodes on the graphics card up to date: as many as can be distinguished.
   * @param {Scene} scene
   * @param {number} apart smallest distance that can be seen [m]
   */
  setWay({ state, motion, numNodes }, apart) {
    const { sessions } = state;
    const firsts = sessions.map(({ first_node: first }) => first);
    const key = [motion.version, numNodes, apart, this.theme.name, this.anchor, firsts].join();
    if (this.way.key === key) return;
    this.way.key = key;
    const poses = motion.nodes.shown;
    const kept = nodesApart(poses, numNodes, apart, firsts);
    const places = new Float32Array(2 * kept.length);
    const lines = new LineList(kept.length, this.anchor);
    const of = sessionsOf(sessions, kept);
    const inks = sessions.length === 0 ? [inkOf(this.theme.inks.trajectory)]
      : sessions.map((_, number) => inkOf(sessionInk(this.theme, sessions, number)));
    kept.forEach((node, i) => {
      const [x, y] = poseAt(poses, node);
      places[2 * i] = x - this.anchor[0];
      places[2 * i + 1] = y - this.anchor[1];
      if (i === 0 || of[i - 1] !== of[i]) return; // each session is a way of its own
      lines.add(...poseAt(poses, kept[i - 1]).slice(0, 2), x, y, inks[of[i]]);
    });
    this.nodes.set(places, kept.length, this.anchor);
    lines.into(this.way);
  }

  /** Draw a circle around each place that is doubtful or wrong. */
  drawPlaces(places) {
    const shown = places.filter(({ severity }) => severity in PLACE_INKS);
    const lines = new LineList(shown.length * CIRCLE_SIDES, this.anchor);
    for (const { x, y, radius, severity } of shown) {
      const ink = inkOf(this.theme.inks[PLACE_INKS[severity]], 0.9);
      for (let side = 0; side < CIRCLE_SIDES; side++) {
        const [a, b] = [side, side + 1].map((at) => (2 * Math.PI * at) / CIRCLE_SIDES);
        lines.add(x + radius * Math.cos(a), y + radius * Math.sin(a),
          x + radius * Math.cos(b), y + radius * Math.sin(b), ink);
      }
    }
    lines.into(this.places);
    this.pen.lines(this.places, 2.4);
  }

  /** Draw the way from the last node to the robot. */
  drawTail({ scan, state, motion, numNodes }) {
    if (numNodes === 0 || numNodes < state.nodes.length) return;
    const last = poseAt(motion.nodes.shown, numNodes - 1);
    const line = new LineList(1, this.anchor);
    const rgb = sessionInk(this.theme, state.sessions, Math.max(state.sessions.length - 1, 0));
    line.add(last[0], last[1], scan.pose[0], scan.pose[1], inkOf(rgb));
    line.into(this.tail);
    this.pen.lines(this.tail, WAY_PX);
  }

  drawScan({ pose, points }, alpha = 0.9) {
    this.setPoints(this.returns, pose, points);
    this.pen.dots(this.returns, 3.2, tint(this.theme.inks.scan, alpha));
  }

  setPoints(shape, pose, points) {
    const places = new Float32Array(points.length);
    for (let i = 0; i < points.length; i += 2) {
      const [x, y] = transform(pose, points[i], points[i + 1]);
      places[i] = x - this.anchor[0];
      places[i + 1] = y - this.anchor[1];
    }
    shape.set(places, places.length / 2, this.anchor);
  }

  drawRobot([x, y, theta], view) {
    const { inks } = this.theme;
    const nose = transform([x, y, theta], ROBOT_PX / view.scale, 0);
    for (const [rgb, more] of [[inks.halo, 4], [inks.robot, 0]]) {
      const line = new LineList(1, this.anchor);
      line.add(x, y, nose[0], nose[1], inkOf(rgb));
      line.into(this.tail);
      this.pen.lines(this.tail, 4 + more);
      this.dots.set(new Float32Array([x - this.anchor[0], y - this.anchor[1]]), 1, this.anchor);
      this.pen.dots(this.dots, 14 + more, tint(rgb, 1));
    }
  }

  /** Bring the lines of constraints up to date. @param {Scene} scene */
  setConstraints(scene, apart) {
    const { state, motion, layers, colouring, numNodes } = scene;
    const key = [motion.version, state.graphVersion, layers.closures, layers.suspects,
      layers.constraints, scene.suspects.version, colouring, numNodes, apart, this.theme.name,
      this.anchor].join();
    if (this.constraints.key === key) return;
    this.constraints.key = key;
    const [submaps, nodes] = [motion.submaps.shown, motion.nodes.shown];
    const { constraints } = state;
    const lines = new LineList(constraints.length, this.anchor);
    for (const row of this.rowsShown(scene, thinning(scene, apart))) {
      const constraint = constraints.at(row);
      const from = beginOf(constraint, submaps, nodes);
      const to = poseAt(nodes, constraint.b);
      lines.add(from[0], from[1], to[0], to[1], this.inkOf(constraint, scene));
    }
    lines.into(this.constraints);
  }

  /**
   * Yield the rows of constraints that are shown.
   * @param {Scene} scene
   * @param {number} every only every n-th node is shown, and all suspects
   */
  * rowsShown({ state, motion, layers, numNodes, suspects }, every = 1) {
    const { a, b, kinds } = state.constraints;
    const numSubmaps = motion.submaps.shown.length / 3;
    for (let row = 0; row < kinds.length; row++) {
      const kind = kinds.numbers[row];
      const isSuspect = kind === Kind.REJECTED || suspects.violated.has(row);
      if (!(isSuspect && layers.suspects)) {
        if (kind === Kind.REJECTED) continue;
        if (!(kind === Kind.CLOSURE ? layers.closures : layers.constraints)) continue;
        if (b.numbers[row] % every !== 0) continue;
      }
      if (b.numbers[row] >= numNodes) continue;
      if (a.numbers[row] >= (kind === Kind.NODES ? numNodes : numSubmaps)) continue;
      yield row;
    }
  }

  inkOf(constraint, { state, motion, colouring, suspects }) {
    const { inks } = this.theme;
    const isClosure = constraint.kind === Kind.CLOSURE || constraint.kind === Kind.REJECTED;
    const alpha = isClosure ? closureAlpha(state.readings?.loop_closures ?? 0) : 0.3;
    if (colouring === "residual") {
      const { share } = residualOf(constraint, motion.submaps.shown, motion.nodes.shown);
      return inkOf(this.theme.residual(share), alpha + 0.5 * Math.min(share, 1));
    }
    if (suspects.violated.has(constraint.row)) return inkOf(inks.violated, 0.9);
    const names = ["intra", "closure", "nodes", "rejected"];
    return inkOf(inks[names[constraint.kind]], constraint.kind === Kind.REJECTED ? 0.9 : alpha);
  }

  /** Draw a closure's search window, its match, and both scans. */
  drawClosure(closure, { motion, pulse, latest }) {
    const { inks } = this.theme;
    const submaps = motion.submaps.shown;
    if (3 * closure.submap + 2 >= submaps.length) return;
    const submap = poseAt(submaps, closure.submap);
    const found = chain(submap, closure.tf_submap_node);
    if (closure.tf_submap_other) {
      this.setPoints(this.dots, chain(submap, closure.tf_submap_other), closure.other_points.flat());
      this.pen.dots(this.dots, 3, tint(inks.matched, 0.9));
    }
    this.setPoints(this.dots, found, closure.points.flat());
    this.pen.dots(this.dots, 3, tint(inks.found, 0.9));
    const lines = new LineList(8, this.anchor);
    const ink = inkOf(inks.found);
    if (closure.window) {
      const { tf_submap_node: centre, linear_m: reach } = closure.window;
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        .map(([u, v]) => transform(submap, centre[0] + u * reach, centre[1] + v * reach));
      corners.forEach((corner, i) => lines.add(...corner, ...corners[(i + 1) % 4], inkOf(inks.window, 0.8)));
    }
    lines.add(submap[0], submap[1], found[0], found[1], ink);
    lines.into(this.frame);
    this.pen.lines(this.frame, closure === latest ? 1.6 + 2 * pulse : 1.8);
    this.dots.set(new Float32Array([found[0] - this.anchor[0], found[1] - this.anchor[1]]), 1, this.anchor);
    if (pulse > 0) this.pen.dots(this.dots, 12 + 48 * (1 - pulse), tint(inks.found, 0.5 * pulse));
    this.pen.dots(this.dots, 9, tint(inks.found, 1));
  }
}

/**
 * Return where the way begins, and where it ends if it does.
 * @param {Scene} scene
 * @returns {{name: "start" | "end", at: number[]}[]}
 */
export function endsOf({ motion, numNodes, isOver }) {
  if (numNodes === 0) return [];
  const poses = motion.nodes.shown;
  const start = { name: "start", at: poseAt(poses, 0) };
  return isOver ? [start, { name: "end", at: poseAt(poses, numNodes - 1) }] : [start];
}

/** Return nodes that are so far apart from one to the next, and the first and last of each session. */
function nodesApart(poses, numNodes, apart, firsts) {
  const isEnd = new Set(firsts.flatMap((first) => [first - 1, first]));
  const kept = [];
  let [x, y] = [Infinity, Infinity];
  for (let node = 0; node < numNodes; node++) {
    const far = Math.hypot(poses[3 * node] - x, poses[3 * node + 1] - y);
    if (!(far < apart) || node === numNodes - 1 || isEnd.has(node)) {
      kept.push(node);
      [x, y] = poseAt(poses, node);
    }
  }
  return kept;
}

/** Return of how many nodes one has its constraints shown: fans of lines hide the map. */
function thinning({ motion, numNodes }, apart) {
  const poses = motion.nodes.shown;
  let way = 0;
  for (let node = 1; node < numNodes; node++) {
    way += Math.hypot(poses[3 * node] - poses[3 * node - 3], poses[3 * node + 1] - poses[3 * node - 2]);
  }
  const step = way / Math.max(numNodes, 1);
  return Math.max(1, 2 ** Math.round(Math.log2((3 * apart) / Math.max(step, 1e-3))));
}

/** Many closures are drawn fainter, one by one, so that the map is seen through them. */
function closureAlpha(count) {
  return Math.min(0.7, Math.max(0.06, 12 / Math.sqrt(count + 1) / 10));
}

function tint(rgb, alpha) {
  return [...rgb.map((value) => value / 255), alpha];
}
