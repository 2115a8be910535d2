// SPDX-License-Identifier: Apache-2.0
/**
 * `window.cartoloop`: what the page shows, for tests and for who looks into it with the browser's tools.
 *
 * - `cartoloop.state()`: see {@link PageState}.
 * - `cartoloop.view`: `{x, y, scale, rotation}`, the point of the map in the middle of the screen [m],
 *   pixels a metre, and by how much the map is turned counter-clockwise [rad]; can be set, all of it or
 *   in part.
 * - `cartoloop.toScreen([x, y])`, `cartoloop.toMap([px, py])`: from a point of the map [m] to CSS pixels
 *   of the window, and back.
 * - `cartoloop.constraint(row)`: a row of the constraints, with both its ends on the screen.
 * - Marks of `performance`: `cartoloop:joined`, `cartoloop:complete`, `cartoloop:first-picture`.
 * @module
 */
import { distance, valueOf } from "./measures_values.js";
import { poseAt } from "./poses.js";
import { beginOf } from "./residual.js";

/**
 * @typedef {object} PageState
 * @property {boolean} connected
 * @property {boolean} complete whether all there was at joining has come
 * @property {boolean} settled whether what is shown is all there is to be seen, and nothing moves
 * @property {string | null} session of the server
 * @property {number} bytes received since joining
 * @property {{nodes: number, submaps: number, previews: number, constraints: number}} counts
 * @property {{cells: number, squares: number}} held bytes of inflated cells of finished submaps; squares
 *   of the composed map
 * @property {{number: number, ms: number | null}} frames drawn so far; mean time from one to the next
 *   while the picture moved
 * @property {number} glides how often the map was adjusted in sight
 * @property {number | null} closure row of the constraint that is looked at
 * @property {{metres: number, onWalls: number} | null} tape the last one, and how many of its ends are
 *   on walls; null while nothing is being measured
 * @property {string[]} measures all that was measured, as text
 * @property {Record<string, any> | null} facts as the server sent them
 * @property {{violated: number, rejected: number, shown: number}} suspects closures to look at first; and
 *   how many closures are drawn
 * @property {boolean} before whether the poses are shown that were before loop closure
 * @property {boolean} following
 * @property {"light" | "dark"} theme
 * @property {number | null} time that is shown, stamp [s]; null: all there is
 * @property {Record<string, any> | null} readings as the server sent them
 * @property {Record<string, any> | null} quality as the server sent it
 * @property {object[]} sessions as the server sent them
 * @property {Record<string, any> | null} edits as the server sent them
 * @property {Record<string, any> | null} localisation as the server sent it
 * @property {[number, string][]} states that a localisation went through
 * @property {number} path number of points of the path in the map
 * @property {number[] | null} given pose that is drawn while it is given by hand
 */

/** @param {any} page */
export function inspector(page) {
  return Object.freeze({
    state: () => stateOf(page),
    get view() {
      const { x, y, scale, rotation } = page.view;
      return { x, y, scale, rotation };
    },
    set view(wanted) {
      for (const name of ["x", "y", "scale", "rotation"]) page.view[name] = wanted[name] ?? page.view[name];
      page.move();
    },
    toScreen: ([x, y]) => page.view.toScreen(x, y),
    toMap: ([px, py]) => page.view.toMap(px, py),
    constraint: (row) => constraintOf(page, row),
  });
}

/** @returns {PageState} */
function stateOf({ connection, state, renderer, motion, stage, closure, measures, camera, theme, playback, session, suspects, poseTool }) {
  return {
    connected: connection.isOpen,
    complete: state.isComplete,
    settled: state.isComplete && !stage.isFirst && !motion.isGliding && renderer.isSettled,
    session: session ?? null,
    bytes: connection.bytes,
    counts: {
      nodes: state.nodes.length, submaps: renderer.submaps.all.size,
      previews: renderer.submaps.previews.size, constraints: state.constraints.length,
    },
    held: { cells: renderer.submaps.cellBytes, squares: renderer.tiles.numTextures },
    frames: { number: stage.numFrames, ms: stage.frameMs },
    glides: motion.numGlides,
    closure: closure.details?.constraint ?? null,
    tape: measures.last && {
      metres: distance(...measures.last.points), onWalls: measures.last.onWall.filter(Boolean).length,
    },
    measures: measures.all.map((measure) => valueOf(measure).value),
    facts: state.facts,
    suspects: {
      violated: suspects.violated.size, rejected: suspects.numRejected, shown: stage.overlays.constraints.count,
    },
    before: state.isBefore,
    following: camera.isFollowing,
    theme: theme.name,
    time: playback.time,
    readings: state.readings,
    quality: state.quality,
    sessions: state.sessions,
    edits: state.edits,
    localisation: state.localisation,
    states: state.states,
    path: state.path.length,
    given: poseTool.pose,
  };
}

function constraintOf({ state, motion, view }, row) {
  if (!(row >= 0 && row < state.constraints.length)) return null;
  const constraint = state.constraints.at(row);
  const nodes = motion.nodes.shown;
  const [begin, end] = [beginOf(constraint, motion.submaps.shown, nodes), poseAt(nodes, constraint.b)];
  return {
    ...constraint, from: view.toScreen(begin[0], begin[1]), to: view.toScreen(end[0], end[1]),
  };
}
