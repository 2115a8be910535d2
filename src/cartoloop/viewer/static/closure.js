// SPDX-License-Identifier: Apache-2.0
/**
 * A loop closure that was clicked on: how sure it is, and both scans laid over each other.
 * @module
 */
import { byId, setText } from "./dom.js";
import { chain, transform } from "./poses.js";
import { Kind } from "./protocol.js";
import { VIOLATED_M, VIOLATED_RAD } from "./residual.js";
import { length, percent, score } from "./words.js";

/** A click finds closures that are so near [px]. */
const PICK_PX = 12;
/** Of closures at one place, that whose node is nearer. */
const NODE_SHARE = 0.05;
/** Of closures at one place, one in the graph rather than a rejected one [px]. */
const REJECTED_PX = 1;
/** What is brought into sight holds this share of the returns: a few are very far. */
const NEAR_SHARE = 0.85;
/** Around a closure at least so much is shown [m]. */
const LEAST_M = 3;
/** Scans that overlap by less show nothing of how well they fit. */
const LITTLE = 0.25;

/**
 * Return the row of the closure that was clicked on, null if there is none: of the lines, the
 * nearest one; of several at one place, the one whose node is nearest.
 * @param {import("./overlays.js").Scene} scene
 * @param {Iterable<number>} rows that are shown
 * @param {import("./view.js").View} view
 */
export function pickClosure({ state, motion }, rows, view, px, py) {
  const [submaps, nodes] = [motion.submaps.shown, motion.nodes.shown];
  const { a, b, kinds } = state.constraints;
  const [x, y] = view.toMap(px, py);
  let best = null;
  let least = PICK_PX / view.scale;
  for (const row of rows) {
    const kind = kinds.numbers[row];
    if (kind !== Kind.CLOSURE && kind !== Kind.REJECTED) continue;
    const from = 3 * a.numbers[row];
    const to = 3 * b.numbers[row];
    const [toX, toY] = [nodes[to], nodes[to + 1]];
    const far = distanceToLine(x, y, submaps[from], submaps[from + 1], toX, toY)
      + (kind === Kind.REJECTED ? REJECTED_PX / view.scale : 0)
      + (NODE_SHARE * Math.hypot(x - toX, y - toY)) / (1 + view.scale);
    if (far < least) [best, least] = [row, far];
  }
  return best;
}

function distanceToLine(x, y, ax, ay, bx, by) {
  const [dx, dy] = [bx - ax, by - ay];
  const square = dx * dx + dy * dy;
  const share = square > 0 ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / square, 0), 1) : 0;
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
}

/** @typedef {import("./view.js").Bounds} Bounds */

/** The card with the details of a closure. */
export class ClosureCard {
  /**
   * @param {object} hooks
   * @param {(request: object) => Promise<any>} hooks.ask the server
   * @param {import("./state.js").MapState} hooks.state
   * @param {import("./theme.js").Theme} hooks.theme
   * @param {() => void} hooks.onChange
   * @param {import("./edits.js").Edits} hooks.edits
   * @param {(text: string) => void} hooks.onHint
   * @param {(bounds: import("./view.js").Bounds) => void} hooks.onShow bring it into sight
   */
  constructor(hooks) {
    this.hooks = hooks;
    this.root = byId("closure");
    /** The CLOSURE message that is shown. @type {Record<string, any> | null} */
    this.details = null;
    /** Pair whose card is opened again after an edit. @type {{submap: number, node: number} | null} */
    this.reopened = null;
    byId("closure-close").addEventListener("click", () => this.close());
    byId("closure-previous").addEventListener("click", () => this.step(-1));
    byId("closure-next").addEventListener("click", () => this.step(1));
    byId("closure-show").addEventListener("click", () => this.bringIntoSight());
    byId("closure-edit").addEventListener("click", () => this.edit());
    new ResizeObserver(() => this.drawScans()).observe(byId("closure-scans"));
  }

  /** Ask for a closure, and show it. @param {number} row */
  async open(row) {
    const { ask, onHint, onChange } = this.hooks;
    try {
      const answer = await ask({ type: "closure", constraint: row });
      this.details = answer.content;
    } catch (problem) {
      onHint(problem.message);
      return;
    }
    this.root.hidden = false;
    this.show();
    onChange();
  }

  close() {
    if (!this.details) return;
    this.details = null;
    this.root.hidden = true;
    this.hooks.onChange();
  }

  /** Go on to the next closure in the order in which they were found. */
  step(by) {
    if (this.details) this.openNext(this.details.constraint, by);
  }

  /** Open the newest closure in the graph, or the last rejected one if there is none. */
  openLatest() {
    const { constraints } = this.hooks.state;
    if (!this.openNext(constraints.length, -1, [Kind.CLOSURE])) this.openNext(constraints.length, -1);
  }

  /** Open the next closure of some kinds; return whether there is one. */
  openNext(from, by, wanted = [Kind.CLOSURE, Kind.REJECTED]) {
    const { kinds } = this.hooks.state.constraints;
    for (let row = from + by; row >= 0 && row < kinds.length; row += by) {
      if (wanted.includes(kinds.numbers[row])) {
        this.open(row).then(() => this.bringIntoSight());
        return true;
      }
    }
    return false;
  }

  bringIntoSight() {
    const { details } = this;
    if (!details) return;
    const found = chain(details.tf_map_submap, details.tf_submap_node);
    const points = details.points.map(([x, y]) => transform(found, x, y));
    this.hooks.onShow(boundsAround(found, points));
  }

  show() {
    const { details } = this;
    const isRejected = this.hooks.state.constraints.kinds.numbers[details.constraint] === Kind.REJECTED;
    const isViolated = details.residual_m > VIOLATED_M || details.residual_deg > (VIOLATED_RAD * 180) / Math.PI;
    setText(byId("closure-title"), `Node ${details.node} in submap ${details.submap}`);
    setText(byId("closure-node"), `node ${details.node}`);
    setText(byId("closure-other"), details.other_node === null ? "no other scan"
      : `node ${details.other_node}, of the submap`);
    const verdict = byId("closure-verdict");
    setText(verdict, verdictOf(details, isRejected, isViolated));
    verdict.classList.toggle("bad", isRejected || isViolated);
    showBar("closure-score-bar", details.score, isRejected || isViolated);
    showBar("closure-runner-bar", details.runner_up, false);
    setText(byId("closure-overlap"), percent(details.overlap));
    byId("closure-score").parentElement.parentElement.hidden = details.score === null;
    byId("closure-runner").parentElement.parentElement.hidden = details.runner_up === null;
    setText(byId("closure-score"), score(details.score));
    setText(byId("closure-runner"), details.runner_up === 0 ? "none" : score(details.runner_up));
    setText(byId("closure-threshold"), details.min_score === null ? "not searched" : score(details.min_score));
    setText(byId("closure-fit"), score(details.fit_residual));
    setText(byId("closure-residual"), `${length(details.residual_m)}, ${details.residual_deg.toFixed(2)}°`);
    setText(byId("closure-window"), details.window
      ? `±${details.window.linear_m.toFixed(1)} m, ±${((details.window.angular_rad * 180) / Math.PI).toFixed(0)}°`
      : "matched at the end only");
    this.showEdit();
    this.drawScans();
  }

  /** Show what can be done with it, where the map may be edited. */
  showEdit() {
    const { details } = this;
    const { edits } = this.hooks;
    const button = byId("closure-edit");
    const isEdited = Number.isInteger(details?.edit);
    const isInGraph = details && this.hooks.state.constraints.kinds.numbers[details.constraint] === Kind.CLOSURE;
    button.hidden = !edits.canEdit || !(isEdited || isInGraph);
    button.disabled = edits.isBusy;
    setText(button, isEdited ? `Undo edit ${details.edit}` : "Drop this closure");
  }

  /** Remove it from the map, or undo the edit that removed or added it. */
  async edit() {
    const { details } = this;
    const { edits } = this.hooks;
    if (!details) return;
    const { edit, submap, node } = details;
    this.reopened = { submap, node }; // when the map as edited has come
    const isDone = await edits.change(Number.isInteger(edit) ? { type: "undo_edit", edit }
      : { type: "drop_closure", submap, node });
    if (!isDone) this.reopened = null;
  }

  /** The map was edited: rows may be others. */
  noteEdit() {
    const { reopened } = this;
    this.reopened = null;
    if (reopened) this.openPair(reopened.submap, reopened.node);
    else this.close();
  }

  /** Open the card of a pair again, whose row may be another one. */
  openPair(submap, node) {
    const { a, b, kinds } = this.hooks.state.constraints;
    for (let row = 0; row < kinds.length; row++) {
      const isClosure = kinds.numbers[row] === Kind.CLOSURE || kinds.numbers[row] === Kind.REJECTED;
      if (isClosure && a.numbers[row] === submap && b.numbers[row] === node) {
        this.open(row);
        return;
      }
    }
    this.close();
  }

  /** Draw both scans in the submap's frame, turned as the map is. */
  drawScans() {
    const { details } = this;
    const canvas = byId("closure-scans");
    if (!details || canvas.clientWidth === 0) return;
    const ratio = Math.min(devicePixelRatio || 1, 3);
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const { found, matched, robot } = this.hooks.theme.inks;
    const submap = details.tf_map_submap;
    const layers = [
      { pose: details.tf_submap_other && chain(submap, details.tf_submap_other), points: details.other_points, ink: matched },
      { pose: chain(submap, details.tf_submap_node), points: details.points, ink: found },
    ].filter(({ pose }) => pose);
    drawPoints(canvas, ratio, layers.map(({ pose, points, ink }) => ({
      ink, robot, at: [pose[0], pose[1]], points: points.map(([x, y]) => transform(pose, x, y)),
    })));
  }
}

/** Why the last pass rejected a closure, by its reason in the record. */
const REASONS = {
  start_residual: "the node did not fit the submap at the adjusted poses",
  residual: "the match fitted poorly",
  translation: "the match was too far from the adjusted pose",
  rotation: "the match was turned too far from the adjusted pose",
  disagrees: "the other constraints contradicted it",
  edit: "an edit removed it",
};

function verdictOf(details, isRejected, isViolated) {
  if (details.status === "removed") return "Removed by an edit of the map.";
  if (details.status === "added" && !isViolated) return "Added by an edit of the map, which agrees with it.";
  if (isRejected) return `Rejected at the end: ${reasonText(details.reason) ?? details.status.replaceAll("_", " ")}.`;
  if (isViolated) return "The map disagrees with it.";
  if (details.overlap === null) return "The map agrees with it.";
  if (details.overlap < LITTLE) return "The map agrees with it, but no single scan of the submap shows the same place.";
  return "The map agrees with it.";
}

/** Return in words why the last pass rejected a closure. @returns {string | undefined} */
export function reasonText(reason) {
  return REASONS[reason];
}

/** Show a share as a bar. A <meter> has its own colours in each browser, whatever the verdict. */
function showBar(id, value, isBad) {
  const bar = byId(id);
  bar.firstElementChild.style.width = `${100 * Math.min(Math.max(value ?? 0, 0), 1)}%`;
  bar.classList.toggle("bad", isBad);
}

/** Return the bounds of most points around a place, those nearest to it. @returns {Bounds} */
function boundsAround(place, points) {
  const reach = ([x, y]) => Math.hypot(x - place[0], y - place[1]);
  const near = [...points].sort((a, b) => reach(a) - reach(b))
    .slice(0, Math.ceil(NEAR_SHARE * points.length));
  const [xs, ys] = [near.map(([x]) => x), near.map(([, y]) => y)];
  return {
    left: Math.min(...xs, place[0] - LEAST_M), right: Math.max(...xs, place[0] + LEAST_M),
    bottom: Math.min(...ys, place[1] - LEAST_M), top: Math.max(...ys, place[1] + LEAST_M),
  };
}

/** Draw points [m, map], most of them in sight. */
function drawPoints(canvas, ratio, layers) {
  const context = canvas.getContext("2d");
  const { left, right, bottom, top } = boundsAround(layers.at(-1).at, layers.flatMap(({ points }) => points));
  const margin = 14 * ratio;
  const scale = Math.min((canvas.width - 2 * margin) / Math.max(right - left, 0.1),
    (canvas.height - 2 * margin) / Math.max(top - bottom, 0.1));
  const place = ([x, y]) => [canvas.width / 2 + (x - (left + right) / 2) * scale,
    canvas.height / 2 - (y - (bottom + top) / 2) * scale];
  for (const { ink, points, at } of layers) {
    context.fillStyle = `rgb(${ink.join(" ")} / 0.75)`;
    for (const point of points) {
      const [x, y] = place(point);
      context.beginPath();
      context.arc(x, y, 1.5 * ratio, 0, 2 * Math.PI);
      context.fill();
    }
    context.fillStyle = `rgb(${ink.join(" ")})`;
    context.beginPath();
    context.arc(...place(at), 4 * ratio, 0, 2 * Math.PI);
    context.fill();
  }
}
