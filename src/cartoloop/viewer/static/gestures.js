// SPDX-License-Identifier: Apache-2.0
/**
 * Hands on the map: mouse, touch and wheel.
 * @module
 */

/** A press that moves by less is a click [px]. */
const CLICK_PX = 5;
/** Angle from which two fingers turn the map: smaller ones occur while zooming. */
const TURN_RAD = 0.14;
const WHEEL_ZOOM = 0.0016;
const SHIFT_TURN = 0.006;

/**
 * @typedef {object} Hands what gestures do
 * @property {() => void} onChange the view has changed by hand
 * @property {() => void} onZoom the same, but it was only zoomed or turned
 * @property {(px: number, py: number, event: PointerEvent) => void} onClick
 * @property {(px: number, py: number, event: PointerEvent) => boolean} onPress whether it is taken:
 *   what is dragged then is not the map
 * @property {(px: number, py: number, event: PointerEvent) => void} onDrag of what was taken
 * @property {(px: number, py: number) => void} onRelease what was taken is let go after it was dragged
 * @property {() => void} onAbandon what was taken is no longer dragged: another finger has come
 * @property {(px: number, py: number, event: PointerEvent) => void} onHover
 */

/** Turns pointers into changes of the view. */
export class Gestures {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./view.js").View} view
   * @param {Hands} hands
   */
  constructor(canvas, view, hands) {
    this.canvas = canvas;
    this.view = view;
    this.hands = hands;
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    this.isTaken = false;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.up(event, true));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1) {
      this.start = { x: event.clientX, y: event.clientY };
      this.isClick = event.button === 0;
      this.turns = event.shiftKey || event.button === 2;
      this.isTaken = event.button === 0 && this.hands.onPress(event.clientX, event.clientY, event);
    } else {
      if (this.isTaken) this.hands.onAbandon();
      this.isClick = false;
      this.isTaken = false;
      this.twist = 0;
    }
    this.canvas.classList.add("dragging");
  }

  move(event) {
    const [x, y] = [event.clientX, event.clientY];
    const before = this.pointers.get(event.pointerId);
    if (!before) {
      this.hands.onHover(x, y, event);
      return;
    }
    if (this.isClick && Math.hypot(x - this.start.x, y - this.start.y) < CLICK_PX) return;
    if (this.isClick) Object.assign(before, this.start);
    this.isClick = false;
    if (this.isTaken) this.hands.onDrag(x, y, event);
    else if (this.pointers.size === 1) this.drag(before, x, y);
    else this.pinch(event.pointerId, before, x, y);
    Object.assign(before, { x, y });
  }

  drag(before, x, y) {
    if (this.turns) {
      const { width, height } = this.view;
      this.view.change(width / 2, height / 2, 1, (x - before.x) * SHIFT_TURN);
    } else {
      this.view.panBy(x - before.x, y - before.y);
    }
    this.hands.onChange();
  }

  pinch(id, before, x, y) {
    const other = [...this.pointers].find(([key]) => key !== id)[1];
    const [oldX, oldY] = [before.x - other.x, before.y - other.y];
    const [newX, newY] = [x - other.x, y - other.y];
    const factor = Math.hypot(newX, newY) / Math.max(Math.hypot(oldX, oldY), 1);
    const turn = Math.atan2(oldX * newY - oldY * newX, oldX * newX + oldY * newY);
    this.twist += turn;
    const isTurning = Math.abs(this.twist) > TURN_RAD;
    this.view.change(other.x, other.y, factor, isTurning ? -turn : 0);
    this.hands.onZoom();
  }

  up(event, isCancelled = false) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.pointers.size === 0) this.canvas.classList.remove("dragging");
    if (this.isTaken && isCancelled) this.hands.onAbandon();
    else if (this.isTaken && !this.isClick) this.hands.onRelease(event.clientX, event.clientY);
    if (this.isClick && !isCancelled) this.hands.onClick(event.clientX, event.clientY, event);
    this.isClick = this.isTaken = false;
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const amount = Math.max(-400, Math.min(400, event.deltaY * lines));
    // Trackpads report a pinch as a wheel with Control.
    const factor = Math.exp(-amount * WHEEL_ZOOM * (event.ctrlKey ? 6 : 1));
    this.view.change(event.clientX, event.clientY, factor);
    this.hands.onZoom();
  }
}
