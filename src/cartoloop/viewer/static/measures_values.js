// SPDX-License-Identifier: Apache-2.0
/**
 * What measurements are in numbers, and as the file that `cartoloop evaluate lines` reads.
 * @module
 */

/** How many points make one, at least and at most. */
export const KINDS = Object.freeze({
  length: { least: 2, most: 2 }, angle: { least: 3, most: 3 }, area: { least: 3, most: 100 },
});

const DEG = 180 / Math.PI;

/** @typedef {import("./measures.js").Measure} Measure */
/** @typedef {[number, number]} Point [m, map] */

/** Return the distance between two points [m]. @param {Point} a @param {Point} b */
export function distance(a, b) {
  return Math.hypot(b[0] - a[0], b[1] - a[1]);
}

/** Return the angle at the second of three points, 0 to 180 degrees. @param {Point[]} points */
export function angleOf([a, corner, b]) {
  const [ax, ay] = [a[0] - corner[0], a[1] - corner[1]];
  const [bx, by] = [b[0] - corner[0], b[1] - corner[1]];
  return DEG * Math.abs(Math.atan2(ax * by - ay * bx, ax * bx + ay * by));
}

/** Return the area within corners [m^2]. @param {Point[]} corners */
export function areaOf(corners) {
  let twice = 0;
  corners.forEach(([x, y], i) => {
    const [nextX, nextY] = corners[(i + 1) % corners.length];
    twice += x * nextY - nextX * y;
  });
  return Math.abs(twice) / 2;
}

/** Return the length around corners [m]. @param {Point[]} corners */
export function perimeterOf(corners) {
  return corners.reduce((sum, corner, i) => sum + distance(corner, corners[(i + 1) % corners.length]), 0);
}

/** Return a measurement in words: its value, and how it was measured. @param {Measure} measure */
export function valueOf({ kind, points, onWall = [] }) {
  if (kind === "angle") return { value: `${angleOf(points).toFixed(1)}°`, detail: "between two sides" };
  if (kind === "area") {
    return { value: `${areaOf(points).toFixed(2)} m²`, detail: `around it ${perimeterOf(points).toFixed(2)} m` };
  }
  const [a, b] = points;
  const heading = (DEG * Math.atan2(b[1] - a[1], b[0] - a[0]) + 360) % 180;
  const how = ["between two points", "from a wall to a point", "from wall to wall"][onWall.filter(Boolean).length];
  return { value: `${distance(a, b).toFixed(2)} m`, detail: `${how}, at ${heading.toFixed(1)}°` };
}

/**
 * Return the file of lines, `x1 y1 x2 y2 [length]`: the length is what a tape in the building said. What
 * is no length is a comment.
 * @param {string} name of the map
 * @param {Measure[]} measures
 */
export function linesText(name, measures) {
  const rows = measures.map((measure) => {
    const numbers = measure.points.flat().map((value) => value.toFixed(4)).join(" ");
    const { value, detail } = valueOf(measure);
    if (measure.kind !== "length") return `# ${measure.kind} ${value}, ${detail}: ${numbers}`;
    return `${numbers}${measure.tape === null ? "" : ` ${measure.tape}`}  # in the map ${value} ${detail}`;
  });
  const head = [`# Measured in the view of ${name.replace(/[^\x20-\x7e]/g, "?")}: metres in the frame of the map.`,
    "# x1 y1 x2 y2 [length by a tape in the building]"];
  return `${[...head, ...rows].join("\n").replace(/²/g, "^2").replace(/°/g, " deg")}\n`;
}
