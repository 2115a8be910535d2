// SPDX-License-Identifier: Apache-2.0
/**
 * Draws a picture whenever something has changed, as often as the screen takes them.
 * @module
 */
import { byId } from "./dom.js";
import { Overlays } from "./overlays.js";

/** Period of drawing while squares are being composed [ms]. */
const REFINE_PERIOD_MS = 250;
/** Time after a gesture in which another one is expected [ms]. */
const HANDLED_MS = 250;
/** Time for which the latest loop closure is highlighted [ms]. */
const PULSE_MS = 1600;
/** Where frames take longer, moving pictures are drawn coarse [ms]. */
const SLOW_MS = 24;
/** Share of the last frame in the mean of how long frames take. */
const FRAME_SHARE = 0.2;

/** What is to be seen, and when it is drawn. */
export class Stage {
  /**
   * @param {object} parts
   * @param {import("./gl/renderer.js").Renderer} parts.renderer
   * @param {import("./state.js").MapState} parts.state
   * @param {import("./motion.js").Motion} parts.motion
   * @param {import("./camera.js").Camera} parts.camera
   * @param {import("./theme.js").Theme} parts.theme
   * @param {import("./layers.js").Layers} parts.layers
   * @param {import("./playback.js").PlaybackBar} parts.playback
   * @param {import("./suspects.js").Suspects} parts.suspects
   * @param {() => void} parts.onDrawn all has been drawn again
   * @param {import("./closure.js").ClosureCard} parts.closure
   * @param {import("./pose_tool.js").PoseTool} parts.poseTool
   */
  constructor(parts) {
    Object.assign(this, parts);
    this.overlays = new Overlays(this.renderer.gl, this.theme);
    /** Whether the first picture of this connection is still to be drawn. */
    this.isFirst = true;
    this.isScheduled = false;
    this.pulseBegan = -Infinity;
    this.handledAt = -Infinity;
    this.drawnAt = 0;
    this.numComposed = 0;
    /** Number of pictures drawn. */
    this.numFrames = 0;
    /** Mean time from one picture to the next while the picture moves [ms]. */
    this.frameMs = null;
    this.wasBusy = false;
  }

  /** A connection begins: what is shown stays until the whole state has come. */
  begin() {
    this.isFirst = true;
    this.drawnAt = performance.now();
    this.motion.clear();
  }

  /** A hand has moved the view. */
  handle() {
    this.handledAt = performance.now();
    this.schedule();
  }

  /** Let the latest closure stand out for a while. */
  pulse() {
    this.pulseBegan = performance.now();
  }

  /** What is drawn each time has changed: the robot, its scan. */
  touch() {
    this.renderer.touch();
    this.schedule();
  }

  /** Something other than the view has changed. */
  change() {
    this.renderer.invalidate();
    this.schedule();
  }

  /** The view may have changed, or there is something to compose. */
  schedule() {
    if (this.isScheduled) return;
    this.isScheduled = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.isScheduled = false;
    this.noteFrame(now);
    const { renderer, motion, playback, camera } = this;
    if (renderer.resize()) renderer.invalidate();
    if (this.hasAll || this.isFirst) motion.update(this.state, now, this.view.scale);
    if (this.suspects.update(now)) renderer.invalidate();
    if (this.hasAll && camera.placeFirst()) renderer.invalidate();
    const isPlaying = playback.advance(now);
    const isPulsing = now - this.pulseBegan < PULSE_MS;
    if (motion.isGliding || isPlaying) renderer.invalidate();
    if (isPulsing) renderer.touch();
    if (playback.isBack) playback.bringScan(() => this.touch());
    const isFollowing = camera.follow(this.robotPose());
    const isGliding = motion.isGliding || playback.isScrubbing;
    const isHandled = now - this.handledAt < HANDLED_MS;
    const isMoving = isGliding || isPlaying || isHandled;
    const more = this.hasAll && !isGliding && !this.isFirst
      && renderer.compose(motion.submaps.shown, (submap) => this.isShown(submap), isHandled);
    this.refine(now, more, isMoving);
    this.draw(now, isGliding, this.isFirst || (isMoving && this.frameMs > SLOW_MS));
    camera.show();
    if (more || isMoving || isPulsing || isFollowing || renderer.map.isCoarse) this.schedule();
    this.wasBusy = isMoving;
  }

  noteFrame(now) {
    const took = now - this.lastFrame;
    if (this.wasBusy && took > 0) {
      this.frameMs = this.frameMs === null ? took : this.frameMs + FRAME_SHARE * (took - this.frameMs);
    }
    this.lastFrame = now;
  }

  /** Draw what has been composed meanwhile, at intervals. */
  refine(now, more, isMoving) {
    const { renderer } = this;
    if (renderer.map.isCoarse && !isMoving) renderer.invalidate();
    if (renderer.work.numComposed === this.numComposed) return;
    if (renderer.map.hasPreview && more && now - this.drawnAt < REFINE_PERIOD_MS) return;
    this.numComposed = renderer.work.numComposed;
    renderer.invalidate();
  }

  draw(now, gliding, coarse) {
    const { renderer, hasAll } = this;
    if (!hasAll && (!this.isFirst || now - this.drawnAt < REFINE_PERIOD_MS)) return;
    const scene = this.scene(now);
    const isDrawn = renderer.draw({
      poses: this.motion.submaps.shown, isShown: (submap) => this.isShown(submap), gliding, coarse,
      drawGraph: (view) => this.overlays.drawGraph(view, scene),
      drawNow: (view) => this.overlays.drawNow(view, scene),
    });
    if (isDrawn) {
      this.drawnAt = now;
      this.onDrawn();
    }
    byId("empty").hidden = renderer.submaps.previews.size > 0;
    this.numFrames++;
    if (!this.isFirst || !hasAll) return;
    this.isFirst = false;
    renderer.whenDrawn(() => {
      performance.mark("cartoloop:first-picture");
      document.getElementById("opening")?.remove(); // the saved picture, shown until now
    });
    this.change();
  }

  /** Draw at once, for who reads the canvas. */
  drawNow() {
    this.renderer.invalidate();
    this.draw(performance.now(), this.motion.isGliding, false);
  }

  /** Whether all submaps can be shown, if only as previews. */
  get hasAll() {
    const { submaps } = this.renderer;
    if (this.state.isComplete) return submaps.numPreviewsPending === 0;
    const count = this.state.submapPoses.length;
    return count > 0 && submaps.previews.size >= count;
  }

  /** Whether a submap is there as of the time that is shown. */
  isShown(submap) {
    if (!this.playback.isBack) return true;
    return !(this.state.firstNodes.get(submap) >= this.playback.numNodes);
  }

  /** @returns {import("./overlays.js").Scene} */
  scene(now) {
    const { state, motion, layers, playback, suspects } = this;
    const isOver = state.isOver && !playback.isBack;
    return {
      state, motion, layers: layers.on, colouring: layers.colouring, suspects, isOver,
      isBefore: state.isBefore,
      numNodes: Math.min(playback.numNodes, motion.nodes.shown.length / 3),
      scan: playback.isBack ? playback.scan : state.scan,
      given: this.poseTool.pose,
      closure: this.closure.details, latest: state.isOver ? null : state.latestClosure,
      pulse: Math.max(0, 1 - (now - this.pulseBegan) / PULSE_MS),
    };
  }

  /** Return where the robot is, as of the time that is shown. */
  robotPose() {
    if (this.state.localisation) return this.state.localisation.map;
    const { scan } = this.playback.isBack ? this.playback : this.state;
    return scan?.pose ?? null;
  }
}
