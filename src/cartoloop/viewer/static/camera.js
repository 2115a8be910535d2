// SPDX-License-Identifier: Apache-2.0
/**
 * Where the camera looks: at the whole map at first, then where it is led, or after the robot.
 * @module
 */
import { byId, store, stored } from "./dom.js";

const FOLLOW_KEY = "cartoloop.follow";
/** Share of the way to the robot that the camera goes with each frame. */
const FOLLOW_SHARE = 0.2;
/** Beyond this it jumps [px]. */
const JUMP_PX = 2000;
/** Share of the screen that a map fills, and one that grows, so that it does not move all the time. */
const FILLED = 0.94;
const GROWING_FILLED = 0.75;
const LEAST_FILLED = 0.45;
const LEAST_INSET_PX = 24;
const REMEMBER_MS = 300;
/** Hands zoom out until the map fills this share of the screen. */
const LEAST_SHARE = 0.3;

/** Leads the view. */
export class Camera {
  /**
   * @param {import("./view.js").View} view
   * @param {object} hooks
   * @param {() => import("./view.js").Bounds | null} hooks.bounds of the map
   * @param {() => boolean} hooks.isFinished whether the map grows no more
   * @param {() => boolean} hooks.isCalm whether nothing shall glide
   * @param {() => void} hooks.onMove
   * @param {() => void} hooks.onShown another view is on the screen
   */
  constructor(view, hooks) {
    this.view = view;
    this.hooks = hooks;
    /** Whether the operator, or the address, has said where to look. */
    this.isPlaced = view.fromText(new URLSearchParams(location.hash.slice(1)).get("view"));
    this.isFollowing = stored(FOLLOW_KEY, false, "sessionStorage") === true;
    this.shown = "";
    this.showFollowing();
  }

  /** Another map is shown: look at all of it. */
  forget() {
    this.isPlaced = false;
  }

  /** The view was changed by hand. */
  take() {
    this.isPlaced = true;
    this.setFollowing(false);
  }

  /** Show all of something. @param {import("./view.js").Bounds | null} bounds */
  look(bounds) {
    if (!bounds) return;
    this.view.fit(bounds, insets(this.view, bounds), FILLED);
    this.take();
    this.hooks.onMove();
  }

  /** Let hands zoom out as long as there is more to see. */
  limit(bounds) {
    const none = { left: 0, right: 0, top: 0, bottom: 0 };
    this.view.minScale = LEAST_SHARE * this.view.fittingScale(bounds, none);
  }

  /** Show the whole map. */
  fit() {
    this.look(this.hooks.bounds());
  }

  /** Show all of a map that nobody has moved yet; return whether that changes anything. */
  placeFirst() {
    const bounds = this.isPlaced ? null : this.hooks.bounds();
    if (!bounds) return false;
    const covered = insets(this.view, bounds);
    this.isPlaced = this.hooks.isFinished();
    const isLarge = this.view.scale > LEAST_FILLED * this.view.fittingScale(bounds, covered);
    if (!this.isPlaced && isLarge && this.view.holds(bounds, covered)) return false;
    this.view.fit(bounds, covered, this.isPlaced ? FILLED : GROWING_FILLED);
    return true;
  }

  setFollowing(isOn) {
    if (isOn === this.isFollowing) return;
    this.isFollowing = isOn;
    store(FOLLOW_KEY, isOn, "sessionStorage");
    this.showFollowing();
    this.hooks.onMove();
  }

  showFollowing() {
    byId("follow").setAttribute("aria-pressed", String(this.isFollowing));
  }

  /**
   * Bring the robot into the middle, softly.
   * @param {import("./poses.js").Pose | null} pose tf_map_tracking
   * @returns {boolean} whether it is on its way there
   */
  follow(pose) {
    if (!this.isFollowing || !pose) return false;
    this.isPlaced = true;
    const { view } = this;
    const [dx, dy] = [pose[0] - view.x, pose[1] - view.y];
    const pixels = Math.hypot(dx, dy) * view.scale;
    if (pixels < 0.5) return false;
    const share = pixels > JUMP_PX || this.hooks.isCalm() ? 1 : FOLLOW_SHARE;
    view.x += share * dx;
    view.y += share * dy;
    return true;
  }

  /** Bring needle and address up to date with the view. */
  show() {
    const text = this.view.toText();
    if (text === this.shown) return;
    this.shown = text;
    byId("needle").style.transform = `rotate(${-this.view.rotation}rad)`;
    this.hooks.onShown();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (this.isPlaced) history.replaceState(null, "", `${location.search}#view=${text}`);
    }, REMEMBER_MS);
  }
}

/**
 * Return how much of the screen is covered on each side, so that something is seen beside what covers
 * it, or below: whichever makes it larger [px].
 * @param {import("./view.js").View} view
 * @param {import("./view.js").Bounds} bounds
 * @returns {import("./view.js").Insets}
 */
function insets(view, bounds) {
  let choices = [{ left: 0, right: 0, top: 0, bottom: LEAST_INSET_PX }];
  for (const id of COVERS) {
    const cover = byId(id).getBoundingClientRect();
    if (cover.width > 0 && cover.height > 0) {
      choices = choices.flatMap((choice) => besides(cover, view).map((free) => join(choice, free)));
    }
  }
  return choices.reduce((a, b) => (view.fittingScale(bounds, b) > view.fittingScale(bounds, a) ? b : a));
}

/** What may cover the map. */
const COVERS = ["panel", "tools", "playback", "closures", "closure", "measures", "pose", "scale"];
/** Of something that spans so much of the screen, nothing is to be seen beside it. */
const SPANS = 0.6;

/** Return the insets that leave the screen beside something, or above or below it. */
function besides({ left, right, top, bottom, width, height }, view) {
  const beside = left + right < view.width ? { left: right } : { right: view.width - left };
  const over = top + bottom < view.height ? { top: bottom } : { bottom: view.height - top };
  if (width > SPANS * view.width) return [over];
  if (height > SPANS * view.height) return [beside];
  return [beside, over];
}

/** Return the larger of both insets on each side. */
function join(a, b) {
  return Object.fromEntries(Object.keys(a).map((side) => [side, Math.max(a[side], b[side] ?? 0)]));
}
