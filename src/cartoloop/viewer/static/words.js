// SPDX-License-Identifier: Apache-2.0
/**
 * Numbers as people read them.
 * @module
 */

/** What is shown where there is no number. */
export const NOTHING = "–";

const thousands = new Intl.NumberFormat("en");

/** Return a count, thousands grouped. */
export function count(value) {
  return value === null || value === undefined ? NOTHING : thousands.format(value);
}

/** Return a duration as 1:02:03 or 2:03. @param {number | null} seconds */
export function duration(seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return NOTHING;
  const whole = Math.max(0, Math.floor(seconds));
  const parts = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const texts = parts.map((part) => String(part).padStart(2, "0"));
  return parts[0] > 0 ? `${parts[0]}:${texts[1]}:${texts[2]}` : `${parts[1]}:${texts[2]}`;
}

/** Return a length in millimetres, centimetres or metres, whichever reads best. */
export function length(metres) {
  if (metres === null || metres === undefined) return NOTHING;
  if (metres < 0.01) return `${(1000 * metres).toFixed(1)} mm`;
  if (metres < 1) return `${(100 * metres).toFixed(1)} cm`;
  return `${metres.toFixed(2)} m`;
}

/** Return a factor: 0.7×, 12×. */
export function factor(value) {
  if (value === null || value === undefined) return NOTHING;
  return `${value < 10 ? value.toFixed(1) : count(Math.round(value))}×`;
}

/** Return a time in milliseconds. */
export function milliseconds(value) {
  if (value === null || value === undefined) return NOTHING;
  return value < 1000 ? `${value.toFixed(value < 10 ? 1 : 0)} ms` : `${(value / 1000).toFixed(1)} s`;
}

/** Return a share of one in percent. */
export function percent(value) {
  return value === null || value === undefined ? NOTHING : `${Math.round(100 * value)}%`;
}

/** Return a share of one in hundredths. */
export function score(value) {
  return value === null || value === undefined ? NOTHING : value.toFixed(2);
}
