// SPDX-License-Identifier: Apache-2.0
/**
 * Where the robot is: how sure that is, where else it may be, and how it was before.
 * @module
 */
import { byId, setText } from "./dom.js";
import { duration, length, NOTHING, percent } from "./words.js";

/** States from the best to the worst, each a row of the history; and the colour of its bars. */
const STATES = Object.freeze({
  located: "--good", ambiguous: "--accent", searching: "--soft", lost: "--warm",
});
/** Bars of states that last shorter are still seen [CSS px]. */
const LEAST_BAR_PX = 2;
const BAR_PX = 8;
/** Latest changes that are read to who cannot see the history. */
const LISTED = 4;
/** Around a place that is shown [m]. */
const MARGIN_M = 6;

/**
 * @typedef {object} LocalisationContent LOCALISATION
 * @property {number | null} stamp of the scan [s]
 * @property {"searching" | "ambiguous" | "located" | "lost" | null} state
 * @property {import("./poses.js").Pose | null} map where the robot is
 * @property {number | null} sigma_m
 * @property {number | null} sigma_rad
 * @property {number | null} agreement
 * @property {number | null} usual_agreement
 * @property {{map: import("./poses.js").Pose, probability: number, score: number}[]} places
 * @property {boolean} can_give
 * @property {{number: number, map: import("./poses.js").Pose, fits: boolean | null} | null} given
 */

/** Return a pose as text. @param {import("./poses.js").Pose} pose */
export function poseText([x, y, theta]) {
  const minus = (text) => text.replaceAll("-", "\u2212");
  return minus(`${x.toFixed(2)}, ${y.toFixed(2)} m, ${((theta * 180) / Math.PI).toFixed(0)}°`);
}

/** The part of the panel that shows LOCALISATION and STATES. */
export class Localisation {
  /**
   * @param {object} hooks
   * @param {import("./state.js").MapState} hooks.state
   * @param {(bounds: import("./view.js").Bounds) => void} hooks.onShow
   */
  constructor({ state, onShow }) {
    this.state = state;
    this.onShow = onShow;
    this.root = byId("localisation");
    this.list = byId("candidates");
    this.canvas = byId("states-bars");
    new ResizeObserver(() => this.drawStates()).observe(this.canvas);
  }

  /** Bring all of it up to date. */
  show() {
    const now = this.state.localisation;
    this.root.hidden = !now?.state;
    if (this.root.hidden) return;
    const figures = {
      agreement: percent(now.agreement),
      usual: now.agreement === null ? NOTHING : percent(now.usual_agreement),
      pose: now.map === null ? NOTHING : poseText(now.map),
      sigma: now.sigma_m === null ? NOTHING : `± ${length(now.sigma_m)}`,
      heading: now.sigma_rad === null ? NOTHING : `± ${((now.sigma_rad * 180) / Math.PI).toFixed(1)}°`,
    };
    for (const [name, text] of Object.entries(figures)) {
      const figure = byId(`read-${name}`);
      setText(figure, text);
      figure.parentElement.hidden = text === NOTHING;
    }
    this.showPlaces(now.places);
    this.drawStates();
  }

  showPlaces(places) {
    const focused = [...this.list.children].findIndex((row) => row.contains(document.activeElement));
    this.list.hidden = places.length === 0;
    while (this.list.children.length > places.length) this.list.lastChild.remove();
    while (this.list.children.length < places.length) this.list.append(this.row(this.list.children.length));
    places.forEach(({ map, probability }, number) => {
      const button = this.list.children[number].firstChild;
      setText(button.firstChild, percent(probability));
      setText(button.lastChild, poseText(map));
    });
    if (focused >= places.length && places.length > 0) this.list.lastChild.firstChild.focus();
  }

  /** Return the row of a place, by its number: places come and go while one is pointed at. */
  row(number) {
    const [row, button, share, pose] = ["li", "button", "strong", "span"]
      .map((tag) => document.createElement(tag));
    button.type = "button";
    button.title = "Show it on the map";
    button.append(share, pose);
    button.addEventListener("click", () => {
      const place = this.state.localisation?.places[number];
      if (!place) return;
      const [x, y] = place.map;
      this.onShow({ left: x - MARGIN_M, right: x + MARGIN_M, bottom: y - MARGIN_M, top: y + MARGIN_M });
    });
    row.append(button);
    return row;
  }

  /** Draw which state was when: a row of bars for each. */
  drawStates() {
    const { states, localisation } = this.state;
    const { canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (states.length === 0 || width === 0 || !localisation) return;
    const ratio = globalThis.devicePixelRatio;
    [canvas.width, canvas.height] = [width, height].map((px) => Math.round(px * ratio));
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const style = getComputedStyle(canvas);
    const names = Object.keys(STATES);
    const lane = height / names.length;
    context.fillStyle = style.getPropertyValue("--faint");
    names.forEach((_, row) => context.fillRect(0, (row + 0.5) * lane - 0.5, width, 1));
    const [first, end] = [states[0][0], localisation.stamp];
    const scale = end > first ? width / (end - first) : 0;
    states.forEach(([begin, state], i) => {
      const until = states[i + 1]?.[0] ?? end;
      const left = Math.min((begin - first) * scale, width - LEAST_BAR_PX);
      const long = Math.max((until - begin) * scale, LEAST_BAR_PX);
      context.fillStyle = style.getPropertyValue(STATES[state]);
      context.fillRect(left, (names.indexOf(state) + 0.5) * lane - BAR_PX / 2, long, BAR_PX);
    });
    setText(byId("states-end"), duration(end - first));
    canvas.setAttribute("aria-label", inWords(states, end));
  }
}

/** Return the latest states in words. */
function inWords(states, end) {
  const latest = states.map(([begin, state], i) => `${state} for ${duration((states[i + 1]?.[0] ?? end) - begin)}`);
  return `States: ${latest.slice(-LISTED).join(", then ")}`;
}
