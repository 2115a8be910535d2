// SPDX-License-Identifier: Apache-2.0
/**
 * The buttons, what they open, and the keys that do the same.
 * @module
 */
import { byId } from "./dom.js";

const PAN_PX = 60;
const ZOOM = 1.3;
const TURN_RAD = Math.PI / 24;

/** Whether a key is for the field that has the focus: boxes and choices take only some. */
function isForField({ target, key }) {
  const field = target instanceof Element ? target.closest("input, select") : null;
  if (field === null) return false;
  return !["checkbox", "radio"].includes(field.type) || key === " " || key.startsWith("Arrow");
}

/** A part of the page that a button opens. */
class Popover {
  constructor(button, root) {
    this.button = byId(button);
    this.root = byId(root);
    this.button.addEventListener("click", () => this.toggle());
  }

  toggle(isOpen = this.root.hidden) {
    for (const other of Popover.all) if (other !== this) other.set(false);
    this.set(isOpen);
  }

  set(isOpen) {
    this.root.hidden = !isOpen;
    this.button.setAttribute("aria-expanded", String(isOpen));
  }

  /** @type {Popover[]} */
  static all = [];
}

/**
 * @typedef {object} Actions what buttons and keys do
 * @property {(view: import("./view.js").View) => void} onView
 * @property {() => void} onZoom zoomed or turned: what is looked at stays the same
 * @property {() => void} fit
 * @property {() => void} toggleFollow
 * @property {() => void} toggleMeasures
 * @property {() => void} finishMeasure
 * @property {() => void} togglePose give the pose of the robot by hand
 * @property {() => void} toggleTable
 * @property {() => void} toggleGrid
 * @property {() => void} toggleBefore
 * @property {() => void} togglePlay
 * @property {() => void} toggleTheme
 * @property {() => void} saveView
 * @property {() => void} saveMap
 * @property {() => void} openLatest the card of the newest closure
 * @property {() => void} putAway close a card, stop measuring
 */

/** Wires buttons and keys. */
export class Tools {
  /** @param {import("./view.js").View} view @param {Actions} actions */
  constructor(view, actions) {
    this.view = view;
    this.actions = actions;
    this.layers = new Popover("layers-button", "layers");
    this.save = new Popover("save-button", "save");
    Popover.all = [this.layers, this.save];
    const help = byId("help");
    const buttons = {
      "zoom-in": () => this.zoom(ZOOM), "zoom-out": () => this.zoom(1 / ZOOM),
      fit: actions.fit, north: () => this.turnUpright(), follow: actions.toggleFollow,
      tape: actions.toggleMeasures, "pose-button": actions.togglePose, "closures-button": actions.toggleTable,
      before: actions.toggleBefore, theme: actions.toggleTheme, "help-button": () => help.showModal(),
      "help-close": () => help.close(), "save-view": () => this.saved(actions.saveView),
      "save-map": () => this.saved(actions.saveMap),
    };
    for (const [id, action] of Object.entries(buttons)) byId(id).addEventListener("click", action);
    help.addEventListener("click", (event) => {
      if (event.target === help) help.close();
    });
    addEventListener("keydown", (event) => this.key(event));
  }

  saved(action) {
    this.save.set(false);
    action();
  }

  closePopovers() {
    for (const popover of Popover.all) popover.set(false);
  }

  zoom(factor) {
    const { width, height } = this.view;
    this.view.change(width / 2, height / 2, factor);
    this.actions.onZoom();
  }

  turn(angle) {
    const { width, height } = this.view;
    this.view.change(width / 2, height / 2, 1, angle);
    this.actions.onZoom();
  }

  turnUpright() {
    this.turn(-this.view.rotation);
  }

  pan(dx, dy) {
    this.view.panBy(dx, dy);
    this.actions.onView();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.ctrlKey || event.metaKey || (event.key !== "Escape" && isForField(event))) return;
    if (byId("help").open) return; // the browser closes it
    const isButton = event.target instanceof HTMLButtonElement;
    if (isButton && (event.key === " " || event.key === "Enter")) return;
    const action = this.actionOf(event.key, event.shiftKey ? 3 : 1);
    if (!action) return;
    event.preventDefault();
    action();
  }

  actionOf(key, times) {
    const step = PAN_PX * times;
    const { actions } = this;
    switch (key) {
      case "ArrowLeft": return () => this.pan(step, 0);
      case "ArrowRight": return () => this.pan(-step, 0);
      case "ArrowUp": return () => this.pan(0, step);
      case "ArrowDown": return () => this.pan(0, -step);
      case "+": case "=": return () => this.zoom(ZOOM);
      case "-": case "_": return () => this.zoom(1 / ZOOM);
      case "[": return () => this.turn(TURN_RAD);
      case "]": return () => this.turn(-TURN_RAD);
      case "0": case "Home": return actions.fit;
      case "n": case "N": return () => this.turnUpright();
      case "c": case "C": return actions.openLatest;
      case "f": case "F": return actions.toggleFollow;
      case "m": case "M": return actions.toggleMeasures;
      case "p": case "P": return actions.togglePose;
      case "Enter": return actions.finishMeasure;
      case "t": case "T": return actions.toggleTable;
      case "g": case "G": return actions.toggleGrid;
      case "b": case "B": return actions.toggleBefore;
      case "l": case "L": return () => this.layers.toggle();
      case "s": case "S": return () => this.save.toggle();
      case "d": case "D": return actions.toggleTheme;
      case "h": case "H": return () => document.body.classList.toggle("alone");
      case "?": return () => byId("help").showModal();
      case " ": return actions.togglePlay;
      case "Escape": return () => {
        this.closePopovers();
        document.body.classList.remove("alone");
        actions.putAway();
      };
      default: return null;
    }
  }
}
