// SPDX-License-Identifier: Apache-2.0
/**
 * All loop closures in a table: sorted by any column, filtered; only the rows in sight are elements.
 * @module
 */
import { byId, setText } from "./dom.js";
import { Kind } from "./protocol.js";
import { residualOf } from "./residual.js";
import { count, length, NOTHING, score } from "./words.js";

const ROW_PX = 32;
/** Rows above and below those in sight. */
const SPARE = 8;

/** @typedef {{row: number, submap: number, node: number, metres: number, degrees: number, score: number | null, fit: number | null, fate: string}} Entry */

/** Columns: key of an entry, title, whether large values come first, and the text of a value. */
const COLUMNS = [
  { key: "submap", title: "submap", text: count },
  { key: "node", title: "node", text: count },
  { key: "metres", title: "residual", isDown: true, text: length },
  { key: "degrees", title: "turned", isDown: true, text: (value) => `${value.toFixed(2)}°` },
  { key: "score", title: "score", text: score },
  { key: "fate", title: "fate", text: (value) => value },
];
/** Fates, the worst first. */
const FATES = ["violated", "rejected", "removed", "agrees"];

/** The table. */
export class ClosureTable {
  /**
   * @param {object} hooks
   * @param {(request: object) => Promise<any>} hooks.ask the server
   * @param {import("./state.js").MapState} hooks.state
   * @param {import("./suspects.js").Suspects} hooks.suspects
   * @param {(text: string) => void} hooks.onHint
   * @param {(row: number) => void} hooks.onOpen a closure was chosen
   */
  constructor(hooks) {
    this.hooks = hooks;
    this.root = byId("closures");
    this.scroll = byId("closures-scroll");
    this.body = byId("closures-rows");
    /** @type {Entry[]} */
    this.entries = [];
    /** Those that pass the filter, sorted. @type {Entry[]} */
    this.shown = [];
    this.sorting = { key: "fate", isDown: false };
    /** Row of the constraint whose card is open. */
    this.chosen = null;
    byId("closures-close").addEventListener("click", () => this.close());
    byId("closures-which").addEventListener("change", () => this.arrange());
    byId("closures-filter").addEventListener("input", () => this.arrange());
    this.scroll.addEventListener("scroll", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.scroll);
    this.body.addEventListener("click", (event) => this.click(event));
    byId("closures-head").replaceChildren(...COLUMNS.map((column) => this.heading(column)));
  }

  get isOpen() {
    return !this.root.hidden;
  }

  async toggle() {
    if (this.isOpen) {
      this.close();
      return;
    }
    this.setOpen(true);
    await this.load();
  }

  close() {
    this.setOpen(false);
    this.entries = this.shown = [];
  }

  setOpen(isOpen) {
    if (!isOpen && this.root.contains(document.activeElement)) document.activeElement.blur();
    this.root.hidden = !isOpen;
    byId("closures-button").setAttribute("aria-expanded", String(isOpen));
  }

  /** Ask for what the record holds, and judge all closures at the poses of the map. */
  async load() {
    const { ask, onHint } = this.hooks;
    try {
      const { content } = await ask({ type: "closures" });
      this.entries = content.constraint
        .map((row, i) => this.entryOf(row, content.score[i], content.reasons[content.reason[i]]))
        .filter((entry) => entry !== null);
    } catch (problem) {
      onHint(problem.message);
      this.close();
      return;
    }
    this.arrange();
  }

  /** @returns {Entry | null} null for one that has come since the last poses */
  entryOf(row, found, reason) {
    const { state, suspects } = this.hooks;
    if (row >= state.constraints.length || !state.knowsEnds(row)) return null;
    const constraint = state.constraints.at(row);
    const { metres, radians } = residualOf(constraint, state.submapPoses.rows, state.nodes.rows);
    const isRejected = constraint.kind === Kind.REJECTED;
    return {
      row, submap: constraint.a, node: constraint.b, metres, degrees: (radians * 180) / Math.PI,
      score: found, fate: isRejected ? (reason === "edit" ? "removed" : "rejected")
        : suspects.violated.has(row) ? "violated" : "agrees",
    };
  }

  /** Filter and sort. */
  arrange() {
    const which = byId("closures-which").value;
    const text = byId("closures-filter").value.trim();
    const number = text === "" ? null : Number(text);
    this.shown = this.entries.filter(({ submap, node, fate }) => (
      (which === "all" || fate === which || (which === "suspects" && fate !== "agrees"))
      && (number === null || submap === number || node === number)));
    const { key, isDown } = this.sorting;
    const valueOf = (entry) => (key === "fate" ? FATES.indexOf(entry.fate) : entry[key] ?? -1);
    // Of the same fate, the largest residual comes first.
    this.shown.sort((a, b) => (isDown ? valueOf(b) - valueOf(a) : valueOf(a) - valueOf(b))
      || b.metres - a.metres || a.row - b.row);
    setText(byId("closures-title"), this.shown.length === this.entries.length
      ? `${count(this.entries.length)} loop closures`
      : `${count(this.shown.length)} of ${count(this.entries.length)} loop closures`);
    byId("closures-none").hidden = this.shown.length > 0;
    this.scroll.scrollTop = 0;
    this.draw();
  }

  heading({ key, title, isDown = false }) {
    const [cell, button] = ["th", "button"].map((tag) => document.createElement(tag));
    cell.scope = "col";
    cell.dataset.key = key;
    button.type = "button";
    button.textContent = title;
    button.addEventListener("click", () => {
      const isSame = this.sorting.key === key;
      this.sorting = { key, isDown: isSame ? !this.sorting.isDown : isDown };
      this.arrange();
    });
    cell.append(button);
    return cell;
  }

  /** Make elements of the rows in sight; what is above and below is one high row each. */
  draw() {
    if (!this.isOpen) return;
    for (const cell of byId("closures-head").children) {
      const isSorted = cell.dataset.key === this.sorting.key;
      const order = this.sorting.isDown ? "descending" : "ascending";
      if (isSorted) cell.setAttribute("aria-sort", order);
      else cell.removeAttribute("aria-sort");
    }
    const { shown } = this;
    const first = Math.max(0, Math.floor(this.scroll.scrollTop / ROW_PX) - SPARE);
    const end = Math.min(shown.length, first + Math.ceil(this.scroll.clientHeight / ROW_PX) + 2 * SPARE);
    this.body.replaceChildren(gap(first), ...shown.slice(first, end).map((entry) => this.line(entry)),
      gap(shown.length - end));
  }

  line(entry) {
    const line = document.createElement("tr");
    line.dataset.row = String(entry.row);
    line.dataset.fate = entry.fate;
    line.tabIndex = 0;
    if (entry.row === this.chosen) line.setAttribute("aria-selected", "true");
    line.append(...COLUMNS.map(({ key, text }) => {
      const cell = document.createElement("td");
      cell.textContent = entry[key] === null ? NOTHING : text(entry[key]);
      return cell;
    }));
    line.addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.choose(entry.row);
    });
    return line;
  }

  click(event) {
    const line = event.target.closest("tr[data-row]");
    if (line) this.choose(Number(line.dataset.row));
  }

  choose(row) {
    this.chosen = row;
    this.draw();
    this.hooks.onOpen(row);
  }
}

/** Return a row as high as some that are not there. */
function gap(rows) {
  const [line, cell] = ["tr", "td"].map((tag) => document.createElement(tag));
  cell.colSpan = COLUMNS.length;
  cell.style.cssText = `height:${rows * ROW_PX}px;padding:0;border:0`;
  line.append(cell);
  line.setAttribute("aria-hidden", "true");
  return line;
}
