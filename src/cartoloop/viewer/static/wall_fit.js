// SPDX-License-Identifier: Apache-2.0
/**
 * Finding a wall's face in the map to a fraction of a cell, as `evaluation/wall_search.py` does it.
 * @module
 */

const HALF_BAND_M = 0.15;
const MAX_RAYS_ASIDE = 20;
const LAYER_CELLS = 2;
const FREE_WITHIN_CELLS = 3;
const SAMPLES_PER_CELL = 20;
const RECENTRINGS = 3;
/** Cells above are occupied, below free: as in the map.yaml that is exported. */
const OCCUPIED = 0.65;
const FREE = 0.196;

/**
 * @typedef {object} Levels the map around a place
 * @property {number} resolution edge of a cell [m]
 * @property {boolean} isPartial whether more will be known of it soon
 * @property {(x: number, y: number) => number} at probability at a point [m, map], -1 unknown
 */

/**
 * @typedef {object} Wall
 * @property {number} distance [m]
 * @property {number} slope tangent of the angle between the wall and the square to the direction
 */

/**
 * Return the first wall that is met, null if there is none.
 *
 * A band of parallel rays is followed. Along a ray, each occupied cell with free space just before
 * it begins a face; the wall is where more than half of the rays first agree on a face, at their
 * median. A face is the middle of the evidence of its first two cells.
 * @param {Levels} levels
 * @param {[number, number]} middle where to start, in free space
 * @param {[number, number]} along unit vector
 * @param {number} near between which distances the wall is [m]
 * @param {number} far
 * @returns {Wall | null}
 */
export function findWall(levels, middle, along, near, far) {
  const { resolution } = levels;
  const halfBand = Math.max(HALF_BAND_M, 1.5 * resolution);
  const aside = Math.min(Math.ceil((2 * halfBand) / resolution), MAX_RAYS_ASIDE);
  const offsets = Array.from({ length: 2 * aside + 1 }, (_, i) => ((i - aside) / aside) * halfBand);
  const faces = offsets.map((offset) => facesOnRay(levels,
    [middle[0] - along[1] * offset, middle[1] + along[0] * offset], along, near, far));
  const candidates = faces.flat().sort((a, b) => a - b);
  for (const candidate of candidates) {
    let agreeing = agreeingFaces(faces, offsets, candidate, resolution);
    if (agreeing.length <= aside) continue;
    let distance = medianOf(agreeing);
    for (let i = 0; i < RECENTRINGS; i++) {
      agreeing = agreeingFaces(faces, offsets, distance, resolution);
      distance = medianOf(agreeing);
    }
    return { distance, slope: slopeOf(agreeing) };
  }
  return null;
}

/** Return the face nearest to a distance on each ray that has one within its tolerance. */
function agreeingFaces(faces, offsets, distance, resolution) {
  const found = [];
  faces.forEach((onRay, i) => {
    let nearest = Infinity;
    for (const face of onRay) {
      if (Math.abs(face - distance) < Math.abs(nearest - distance)) nearest = face;
    }
    // An oblique wall is met at different distances, up to 45 degrees.
    if (Math.abs(nearest - distance) <= Math.abs(offsets[i]) + 2 * resolution) {
      found.push({ offset: offsets[i], face: nearest });
    }
  });
  return found;
}

function medianOf(agreeing) {
  const faces = agreeing.map(({ face }) => face).sort((a, b) => a - b);
  return faces[Math.floor(faces.length / 2)];
}

/** Return by how much faces recede along the band: least squares. */
function slopeOf(agreeing) {
  const n = agreeing.length;
  const mean = (key) => agreeing.reduce((sum, one) => sum + one[key], 0) / n;
  const [offset, face] = [mean("offset"), mean("face")];
  let [both, square] = [0, 0];
  for (const one of agreeing) {
    both += (one.offset - offset) * (one.face - face);
    square += (one.offset - offset) ** 2;
  }
  return square > 0 ? both / square : 0;
}

/** Return the distances of all faces along a ray. */
function facesOnRay(levels, [x, y], along, near, far) {
  const { resolution } = levels;
  const step = resolution / SAMPLES_PER_CELL;
  const margin = FREE_WITHIN_CELLS * resolution;
  const start = near - margin;
  const count = Math.max(0, Math.ceil((far + margin - start) / step));
  const distanceOf = (i) => start + (i + 0.5) * step;
  const level = new Float32Array(count);
  for (let i = 0; i < count; i++) {
    const distance = distanceOf(i);
    level[i] = levels.at(x + along[0] * distance, y + along[1] * distance);
  }
  const faces = [];
  for (let first = 1; first < count; first++) {
    if (!(level[first] > OCCUPIED && level[first - 1] <= OCCUPIED)) continue;
    if (!isFreeBefore(level, first)) continue;
    const [begin, end] = layerAt(level, first);
    let [sum, weight] = [0, 0];
    for (let i = begin; i < end; i++) {
      const occupied = Math.max(level[i] - 0.5, 0);
      sum += occupied * distanceOf(i);
      weight += occupied;
    }
    const face = sum / weight;
    if (face >= near && face <= far) faces.push(face);
  }
  return faces;
}

function isFreeBefore(level, first) {
  for (let i = first - 1; i >= Math.max(0, first - FREE_WITHIN_CELLS * SAMPLES_PER_CELL); i--) {
    if (level[i] >= 0 && level[i] < FREE) return true;
  }
  return false;
}

/** Return first and end sample of a face: the grey before it, and at most two cells. */
function layerAt(level, first) {
  let begin = first;
  while (begin > 0 && level[begin - 1] > 0.5) begin--;
  let end = Math.min(begin + LAYER_CELLS * SAMPLES_PER_CELL, level.length);
  for (let i = first; i < end; i++) {
    if (level[i] <= 0.5) end = i;
  }
  return [begin, end];
}
