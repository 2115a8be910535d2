// SPDX-License-Identifier: Apache-2.0
/**
 * Poses in the plane, `[x, y, theta]`; `tf_a_b` takes coordinates in b to a.
 * @module
 */

/** @typedef {[number, number, number]} Pose */

/** Return an angle within -pi and pi. */
export function wrapAngle(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

/**
 * Return row `index` of poses that lie one after the other.
 * @param {ArrayLike<number>} poses
 * @param {number} index
 * @returns {Pose}
 */
export function poseAt(poses, index) {
  return [poses[3 * index], poses[3 * index + 1], poses[3 * index + 2]];
}

/**
 * Return where a point is in the frame that the pose leads to.
 * @param {Pose} pose
 * @returns {[number, number]}
 */
export function transform([x, y, theta], px, py) {
  const cos = Math.cos(theta);
  const sin = Math.sin(theta);
  return [x + cos * px - sin * py, y + sin * px + cos * py];
}

/**
 * Return tf_a_c of tf_a_b and tf_b_c.
 * @param {Pose} first
 * @param {Pose} second
 * @returns {Pose}
 */
export function chain(first, second) {
  const [x, y] = transform(first, second[0], second[1]);
  return [x, y, wrapAngle(first[2] + second[2])];
}

/**
 * Return tf_b_c of tf_a_b and tf_a_c.
 * @param {Pose} tfAB
 * @param {Pose} tfAC
 * @returns {Pose}
 */
export function relative(tfAB, tfAC) {
  const dx = tfAC[0] - tfAB[0];
  const dy = tfAC[1] - tfAB[1];
  const cos = Math.cos(tfAB[2]);
  const sin = Math.sin(tfAB[2]);
  return [cos * dx + sin * dy, cos * dy - sin * dx, wrapAngle(tfAC[2] - tfAB[2])];
}
