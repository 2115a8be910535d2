// SPDX-License-Identifier: Apache-2.0
/**
 * Light and dark: as the system has it, or as the operator wants it.
 * @module
 */
import { store, stored } from "./dom.js";

const KEY = "cartoloop.theme";

/** @typedef {[number, number, number]} Rgb */
/** @typedef {import("./shades.js").MapColours} MapColours */

/**
 * Colours over the map, after Okabe and Ito: distinguishable with any colour vision.
 * @type {Record<"light" | "dark", Record<string, Rgb>>}
 */
const INKS = {
  light: {
    trajectory: [0, 114, 178], scan: [213, 94, 0], node: [0, 114, 178], robot: [0, 90, 150],
    halo: [255, 255, 255], closure: [213, 94, 0], intra: [86, 150, 190], nodes: [0, 158, 115],
    rejected: [170, 60, 140], violated: [200, 40, 20], start: [0, 121, 90], end: [27, 31, 37],
    grid: [48, 52, 58], window: [94, 98, 104], matched: [0, 114, 178], found: [213, 94, 0],
    doubtful: [230, 159, 0], wrong: [204, 51, 119], candidate: [146, 98, 0], given: [170, 60, 140],
  },
  dark: {
    trajectory: [86, 180, 233], scan: [240, 150, 60], node: [86, 180, 233], robot: [86, 180, 233],
    halo: [20, 23, 27], closure: [240, 128, 60], intra: [90, 140, 175], nodes: [40, 190, 145],
    rejected: [230, 150, 210], violated: [255, 110, 80], start: [76, 201, 160], end: [244, 240, 230],
    grid: [236, 235, 231], window: [170, 175, 182], matched: [86, 180, 233],
    found: [240, 128, 60], doubtful: [240, 180, 40], wrong: [240, 90, 150], candidate: [230, 210, 80],
    given: [230, 150, 210],
  },
};

/**
 * Colours of sessions, one after the other: as different in lightness as in hue.
 * @type {Record<"light" | "dark", Rgb[]>}
 */
const SESSION_INKS = {
  light: [[0, 114, 178], [213, 94, 0], [0, 158, 115], [170, 60, 140], [146, 98, 0], [70, 70, 200]],
  dark: [[86, 180, 233], [240, 150, 60], [40, 190, 145], [230, 150, 210], [230, 210, 80], [170, 170, 255]],
};

/** From what agrees to what is violated: from blue over yellow-grey to red, ever darker or lighter. */
const RESIDUALS = {
  light: [[0, 114, 178], [120, 140, 120], [214, 150, 30], [200, 60, 10]],
  dark: [[86, 180, 233], [140, 170, 150], [236, 190, 80], [255, 110, 60]],
};

/** Knows which theme is on. */
export class Theme {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    this.system = matchMedia("(prefers-color-scheme: dark)");
    this.system.addEventListener("change", () => this.apply());
    /** @type {"light" | "dark" | null} null: as the system has it */
    this.chosen = stored(KEY, null);
    if (!(this.chosen in INKS)) this.chosen = null;
    /** Colours of the map by theme, as HELLO has them. @type {Record<string, MapColours> | null} */
    this.colours = null;
    this.apply();
  }

  /** @returns {"light" | "dark"} */
  get name() {
    return this.chosen ?? (this.system.matches ? "dark" : "light");
  }

  get inks() {
    return INKS[this.name];
  }

  get sessionInks() {
    return SESSION_INKS[this.name];
  }

  /** Colours of the map; before any has come there is only ground. @returns {MapColours} */
  get map() {
    if (this.colours) return this.colours[this.name];
    const hex = getComputedStyle(document.documentElement).getPropertyValue("--ground");
    const ground = [1, 3, 5].map((at) => Number.parseInt(hex.trim().slice(at, at + 2), 16));
    return { ground, floor: ground, wall: ground };
  }

  /** Go over to the other one. */
  toggle() {
    this.chosen = this.name === "dark" ? "light" : "dark";
    store(KEY, this.chosen);
    this.apply();
  }

  apply() {
    document.documentElement.dataset.theme = this.name;
    this.onChange();
  }

  /** Return the colour of a residual, from 0 to 1, at which it is violated. @returns {Rgb} */
  residual(share) {
    const ramp = RESIDUALS[this.name];
    const at = Math.min(Math.max(share, 0), 1) * (ramp.length - 1);
    const low = Math.min(Math.floor(at), ramp.length - 2);
    return ramp[low].map((value, i) => Math.round(value + (at - low) * (ramp[low + 1][i] - value)));
  }
}
