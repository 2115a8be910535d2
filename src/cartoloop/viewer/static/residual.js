// SPDX-License-Identifier: Apache-2.0
/**
 * How far constraints are from being fulfilled.
 * @module
 */
import { chain, poseAt, relative } from "./poses.js";
import { Kind } from "./protocol.js";

/** Beyond these a closure is violated, and taken to be false [m, rad]. */
export const VIOLATED_M = 0.2;
export const VIOLATED_RAD = Math.PI / 180;

/**
 * @typedef {object} Residual
 * @property {number} metres
 * @property {number} radians
 * @property {number} share of what is allowed: above 1 it is violated
 */

/**
 * Return the pose of what a constraint begins at.
 * @param {import("./state.js").Constraint} constraint
 */
export function beginOf(constraint, submaps, nodes) {
  return poseAt(constraint.kind === Kind.NODES ? nodes : submaps, constraint.a);
}

/**
 * Return where the node of a constraint would be if the constraint were fulfilled.
 * @param {import("./state.js").Constraint} constraint
 */
export function measuredPose(constraint, submaps, nodes) {
  return chain(beginOf(constraint, submaps, nodes), constraint.pose);
}

/**
 * Return what is left of a constraint at these poses.
 * @param {import("./state.js").Constraint} constraint
 * @returns {Residual}
 */
export function residualOf(constraint, submaps, nodes) {
  const [x, y, theta] = relative(measuredPose(constraint, submaps, nodes), poseAt(nodes, constraint.b));
  const metres = Math.hypot(x, y);
  const radians = Math.abs(theta);
  return { metres, radians, share: Math.max(metres / VIOLATED_M, radians / VIOLATED_RAD) };
}
