// SPDX-License-Identifier: Apache-2.0
/**
 * The sessions of a map: each has a colour; those that are apart from the map are said to be.
 * @module
 */
import { byId } from "./dom.js";

/**
 * @typedef {object} Session
 * @property {string} name
 * @property {number} first_node where it begins
 * @property {number} first_submap
 * @property {number} part of the map; poses of different parts are not known relative to each other
 */

/** Return the colour of a session: that of the trajectory where there is only one. */
export function sessionInk(theme, sessions, number) {
  const { inks, sessionInks } = theme;
  return sessions.length > 1 ? sessionInks[number % sessionInks.length] : inks.trajectory;
}

/** Return the session of each of some nodes, ascending. @returns {number[]} */
export function sessionsOf(sessions, nodes) {
  let number = 0;
  return nodes.map((node) => {
    while (number + 1 < sessions.length && sessions[number + 1].first_node <= node) number++;
    return number;
  });
}

/** The list of sessions, where there are several. */
export class Sessions {
  /** @param {import("./theme.js").Theme} theme */
  constructor(theme) {
    this.theme = theme;
    this.list = byId("sessions");
    /** @type {Session[]} */
    this.shown = [];
  }

  /** @param {Session[]} sessions */
  show(sessions) {
    this.shown = sessions;
    this.list.hidden = sessions.length < 2;
    this.list.replaceChildren(...(sessions.length < 2 ? [] : sessions).map(({ name, part }, number) => {
      const [row, swatch, text] = ["li", "i", "span"].map((tag) => document.createElement(tag));
      swatch.className = "swatch";
      swatch.style.setProperty("--swatch", `rgb(${sessionInk(this.theme, sessions, number).join(" ")})`);
      text.textContent = part === 0 ? name : `${name}: apart from the map, drawn beside it`;
      row.dataset.part = String(part);
      row.append(swatch, text);
      return row;
    }));
  }

  /** The theme has changed. */
  refresh() {
    this.show(this.shown);
  }
}
