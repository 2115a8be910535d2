// SPDX-License-Identifier: Apache-2.0
/**
 * The readings: state in words, figures, what was skipped and why.
 * @module
 */
import { byId, setText, store, stored } from "./dom.js";
import { count, duration, factor, length, milliseconds, NOTHING } from "./words.js";

const KEY = "cartoloop.readings";

/** Shows READINGS. */
export class Panel {
  constructor() {
    this.root = byId("panel");
    this.facts = byId("facts");
    const toggle = byId("panel-toggle");
    const open = (isOpen) => {
      this.root.classList.toggle("open", isOpen);
      toggle.setAttribute("aria-expanded", String(isOpen));
    };
    open(stored(KEY, innerWidth > 640 && innerHeight > 620));
    toggle.addEventListener("click", () => {
      const isOpen = !this.root.classList.contains("open");
      open(isOpen);
      store(KEY, isOpen);
    });
  }

  /** @param {{name: string}} hello */
  begin({ name, program }) {
    setText(byId("name"), name);
    setText(byId("about"), program);
    document.title = `${name} · cartoloop`;
  }

  /** @param {Record<string, any>} now READINGS */
  show(now) {
    this.root.classList.remove("blank");
    const isOver = ["finished", "stopped", "failed"].includes(now.state);
    byId("closures-button").hidden = !(now.loop_closures > 0);
    const figures = {
      time: duration(now.time_s),
      factor: factor(now.real_time_factor),
      closures: count(now.loop_closures),
      loops: isOver ? count(now.loop_closures) : NOTHING,
      scans: now.scans_total && now.scans_total !== now.scans
        ? `${count(now.scans)} of ${count(now.scans_total)}` : count(now.scans),
      nodes: count(now.nodes),
      submaps: count(now.submaps),
      constraints: count(now.constraints),
      backlog: isOver ? NOTHING : count(now.backlog),
      adjustment: isOver ? NOTHING : adjustment(now.adjustment),
      uncertain: length(now.uncertain_m),
      memory: now.memory_mb && !isOver ? `${count(now.memory_mb)} MB` : NOTHING,
      skipped: sum(now.skipped) > 0 ? count(sum(now.skipped)) : NOTHING,
    };
    for (const [name, text] of Object.entries(figures)) {
      const figure = byId(`read-${name}`);
      setText(figure, text);
      figure.parentElement.hidden = text === NOTHING;
    }
    this.showProgress(now);
    this.showSkipped(now.skipped);
  }

  /**
   * Show what one asks of a map first; instead of the figures of its growth.
   * @param {{described: [string, string][], duration_s: number, verdict: string} | null} facts
   */
  showFacts(facts) {
    this.facts.hidden = facts === null;
    this.root.classList.toggle("ended", facts !== null);
    const rows = facts ? [...facts.described.slice(0, -1), ["recorded time", duration(facts.duration_s)],
      facts.described.at(-1)] : [];
    this.facts.replaceChildren(...rows.map(([name, text]) => {
      const [row, term, value] = ["div", "dt", "dd"].map((tag) => document.createElement(tag));
      term.textContent = name;
      value.textContent = text;
      if (name === "verdict") value.dataset.verdict = facts.verdict;
      row.append(term, value);
      return row;
    }));
  }

  /** @param {number} numViolated @param {number} numRejected closures */
  showSuspects(numViolated, numRejected) {
    for (const [name, number] of [["violated", numViolated], ["rejected", numRejected]]) {
      setText(byId(`read-${name}`), count(number));
      byId(`read-${name}`).parentElement.hidden = number === 0;
    }
  }

  showProgress({ state, time_s: time, duration_s: whole }) {
    const progress = byId("progress");
    progress.hidden = !whole || ["finished", "stopped", "failed"].includes(state);
    if (!progress.hidden) {
      progress.firstElementChild.style.width = `${Math.min(100, (100 * time) / whole)}%`;
    }
  }

  showSkipped(skipped) {
    const rows = Object.entries(skipped ?? {}).map(([reason, times]) => {
      const [row, name, number] = ["li", "span", "span"].map((tag) => document.createElement(tag));
      name.textContent = reason;
      number.textContent = count(times);
      row.append(name, number);
      return row;
    });
    byId("skipped").replaceChildren(...rows);
  }
}

function sum(counts) {
  return Object.values(counts ?? {}).reduce((total, value) => total + value, 0);
}

function adjustment(runs) {
  if (!runs || runs.last_ms === null) return NOTHING;
  return milliseconds(runs.last_ms);
}
