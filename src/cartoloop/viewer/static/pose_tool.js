// SPDX-License-Identifier: Apache-2.0
/**
 * A pose that is given by hand: pressed where the robot is and dragged to where it faces, or filled in.
 * @module
 */
import { byId, setText } from "./dom.js";

const FIELDS = Object.freeze(["x", "y", "heading"]);
const DEGREES = 180 / Math.PI;
/** No map reaches so far [m]; the server refuses more. */
const FARTHEST_M = 1e5;

/** @typedef {import("./poses.js").Pose} Pose */

/** The card, and what is drawn on the map. */
export class PoseTool {
  /**
   * @param {import("./view.js").View} view
   * @param {object} hooks
   * @param {import("./state.js").MapState} hooks.state
   * @param {(request: object) => Promise<any>} hooks.ask the server
   * @param {(text: string) => void} hooks.onHint
   * @param {() => void} hooks.onTouch what is drawn has changed
   * @param {(isOn: boolean) => void} hooks.onToggle
   */
  constructor(view, hooks) {
    this.view = view;
    this.hooks = hooks;
    this.card = byId("pose");
    this.isOn = false;
    /** The pose that is drawn: being dragged, filled in, or tried. @type {Pose | null} */
    this.pose = null;
    /** Where it was pressed [m, map]. @type {[number, number] | null} */
    this.pressed = null;
    /** Number of the pose whose outcome is awaited. @type {number | null} */
    this.waitsFor = null;
    this.hasKeys = matchMedia("(pointer: fine)");
    byId("pose-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
    for (const name of FIELDS) byId(`pose-${name}`).addEventListener("input", () => this.read());
  }

  get canGive() {
    return this.hooks.state.localisation?.can_give === true;
  }

  toggle(isOn = !this.isOn) {
    if (isOn && !this.canGive) {
      this.hooks.onHint("No more scans come: a pose cannot be tried.");
      return;
    }
    if (isOn === this.isOn) return;
    this.isOn = isOn;
    this.pressed = this.pose = null;
    if (!isOn && this.card.contains(document.activeElement)) byId("pose-button").focus();
    this.card.hidden = !isOn;
    this.say("");
    if (isOn) {
      this.fillWith(this.hooks.state.localisation.map);
      if (this.hasKeys.matches) byId("pose-x").select(); // on glass it would bring up keys
    }
    this.hooks.onToggle(isOn);
    this.hooks.onTouch();
  }

  /** Take a press on the map; return whether it was taken. @param {PointerEvent} event */
  press(px, py, event) {
    if (!this.isOn || event.shiftKey) return false;
    this.pressed = this.view.toMap(px, py);
    return true;
  }

  drag(px, py) {
    if (!this.pressed) return;
    const [x, y] = this.pressed;
    const [toX, toY] = this.view.toMap(px, py);
    this.pose = [x, y, Math.atan2(toY - y, toX - x)];
    this.fillWith(this.pose);
    this.hooks.onTouch();
  }

  release(px, py) {
    if (!this.pressed) return;
    this.drag(px, py);
    this.pressed = null;
    this.give(this.pose);
  }

  /** Another finger has come, or the system has taken the pointer. */
  abandon() {
    if (!this.pressed) return;
    this.pressed = this.pose = null;
    this.hooks.onTouch();
  }

  /** A click says where, but not which way. */
  click(px, py) {
    this.pressed = null;
    const [x, y] = this.view.toMap(px, py);
    const heading = numberOf(byId("pose-heading").value) ?? 0;
    this.pose = [x, y, heading / DEGREES];
    this.fillWith(this.pose);
    this.say("Drag to where it faces, or fill in the heading.");
    this.hooks.onTouch();
  }

  /** The localiser has said something new. */
  show() {
    const { state } = this.hooks;
    byId("pose-button").disabled = !this.canGive;
    if (!this.isOn) return;
    if (!this.canGive) this.toggle(false);
    const given = state.localisation?.given;
    if (!given || this.waitsFor === null || given.number < this.waitsFor) return;
    const isOther = given.number > this.waitsFor;
    if (!isOther && given.fits === null) return;
    this.waitsFor = this.pose = null;
    if (isOther) {
      this.say("Another page has given a pose.");
    } else if (given.fits) {
      this.toggle(false);
      this.hooks.onHint("The scan fits there: the robot is located.");
    } else {
      this.say("The scan does not fit there. The pose is not believed.", true);
    }
    this.hooks.onTouch();
  }

  submit() {
    const pose = this.read();
    if (pose) this.give(pose);
    else this.say("Fill in three numbers.", true);
  }

  /** Return the pose that is filled in, null where it is none. @returns {Pose | null} */
  read() {
    const values = FIELDS.map((name) => {
      const field = byId(`pose-${name}`);
      const value = numberOf(field.value);
      field.setAttribute("aria-invalid", String(value === null && field.value.trim() !== ""));
      return value;
    });
    const isPose = values.every((value) => value !== null);
    this.pose = isPose ? [values[0], values[1], wrapped(values[2]) / DEGREES] : null;
    this.hooks.onTouch();
    return this.pose;
  }

  /** @param {Pose} pose */
  async give(pose) {
    this.waitsFor = null;
    if (Math.max(Math.abs(pose[0]), Math.abs(pose[1])) > FARTHEST_M) {
      this.say("That is outside of the map.", true);
      return;
    }
    this.say("The pose is tried at the next scan.");
    try {
      const { content } = await this.hooks.ask({ type: "set_pose", pose });
      this.waitsFor = content.number;
      this.show();
    } catch (problem) {
      this.waitsFor = null;
      this.say(problem.message, true);
    }
  }

  fillWith(pose) {
    const values = pose ? [pose[0].toFixed(2), pose[1].toFixed(2), (pose[2] * DEGREES).toFixed(0)] : ["", "", ""];
    FIELDS.forEach((name, i) => {
      const field = byId(`pose-${name}`);
      field.value = values[i];
      field.removeAttribute("aria-invalid");
    });
  }

  say(text, isBad = false) {
    const outcome = byId("pose-outcome");
    setText(outcome, text);
    outcome.classList.toggle("bad", isBad);
  }
}

/** Return a number that was filled in, null if it is none. @param {string} text */
function numberOf(text) {
  const number = Number(text.trim().replace(",", ".").replace("\u2212", "-"));
  return text.trim() !== "" && Number.isFinite(number) ? number : null;
}

/** Return an angle within half a turn [deg]. */
function wrapped(degrees) {
  return degrees - 360 * Math.round(degrees / 360);
}
