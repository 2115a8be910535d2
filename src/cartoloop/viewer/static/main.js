// SPDX-License-Identifier: Apache-2.0
/**
 * The page: what comes from the server is kept, what changes is drawn, what hands do is done.
 * For tests, and for who looks into the page with the browser's tools, see inspect.js.
 * @module
 */
import { Camera } from "./camera.js";
import { ClosureCard, pickClosure } from "./closure.js";
import { ClosureTable } from "./closure_table.js";
import { Connection, socketUrl } from "./connection.js";
import { byId } from "./dom.js";
import { Edits } from "./edits.js";
import { Gestures } from "./gestures.js";
import { Renderer } from "./gl/renderer.js";
import { Hint } from "./hint.js";
import { inspector } from "./inspect.js";
import { roundText } from "./grid.js";
import { Layers } from "./layers.js";
import { Localisation } from "./localisation.js";
import { Marks } from "./marks.js";
import { Measures } from "./measures.js";
import { Motion } from "./motion.js";
import { Panel } from "./panel.js";
import { Places } from "./places.js";
import { PlaybackBar } from "./playback.js";
import { PoseTool } from "./pose_tool.js";
import { PROTOCOL_VERSION, Type } from "./protocol.js";
import { drawFoot, saveBlob, savePng } from "./save.js";
import { ScaleBar } from "./scale_bar.js";
import { Sessions } from "./sessions.js";
import { Stage } from "./stage.js";
import { MapState } from "./state.js";
import { Status } from "./status.js";
import { Suspects } from "./suspects.js";
import { Theme } from "./theme.js";
import { Tools } from "./tools.js";
import { View } from "./view.js";

/** All parts of the page, and what goes on between them. */
class Page {
  constructor() {
    const change = () => this.stage?.change();
    this.status = new Status();
    this.canvas = byId("map");
    this.view = new View();
    this.state = new MapState();
    this.motion = new Motion();
    this.suspects = new Suspects(this.state);
    this.hint = new Hint();
    this.scaleBar = new ScaleBar();
    this.marks = new Marks(this.view);
    this.panel = new Panel();
    this.theme = new Theme(() => this.changeTheme());
    this.layers = new Layers(this.theme, change);
    this.renderer = new Renderer(this.canvas, this.view, () => {
      this.measures?.refresh();
      this.stage?.schedule();
    });
    this.renderer.map.colours = this.theme.map;
    this.camera = new Camera(this.view, {
      bounds: () => this.bounds(),
      isFinished: () => this.state.isOver || this.isLocating,
      isCalm: () => this.motion.calm.matches,
      onMove: () => this.stage?.schedule(),
      onShown: () => this.showView(),
    });
    const hooks = {
      state: this.state, suspects: this.suspects, theme: this.theme, onChange: change,
      ask: (request) => this.connection.ask(request),
      send: (request) => this.connection.send(request),
      onHint: (text) => this.hint.show(text),
      onShow: (bounds) => this.camera.look(bounds),
      onOpen: (row) => this.openClosure(row),
      levelsAround: (point, reach) => this.renderer.work.levelsAround(point, reach),
    };
    this.playback = new PlaybackBar(hooks);
    this.edits = new Edits({ ...hooks, onEdited: () => this.closure.showEdit() });
    this.closure = new ClosureCard({ ...hooks, edits: this.edits });
    this.sessions = new Sessions(this.theme);
    this.places = new Places(hooks.onShow);
    this.table = new ClosureTable(hooks);
    this.measures = new Measures(this.view, hooks);
    this.localisation = new Localisation(hooks);
    this.poseTool = new PoseTool(this.view, {
      ...hooks, onTouch: () => this.stage?.touch(), onToggle: (isOn) => this.showGiving(isOn),
    });
    this.stage = new Stage({ ...this, onDrawn: () => this.showOver() });
    this.tools = new Tools(this.view, this.actions());
    byId("pose-close").addEventListener("click", () => this.poseTool.toggle(false));
    byId("measures-close").addEventListener("click", () => this.setMeasuring(false));
    this.canvas.addEventListener("pointerleave", () => this.scaleBar.point(null));
    this.gestures = new Gestures(this.canvas, this.view, this.hands());
    this.status.watch(this.canvas);
    new ResizeObserver(change).observe(this.canvas);
    this.connection = new Connection(socketUrl(), {
      onOpen: () => this.begin(),
      onMessage: (message) => this.take(message),
      onStatus: (status) => this.status.show(status, this.state.readings),
    });
    change();
  }

  // What comes from the server

  /** A new connection: what was known is void, but stays on the screen until the rest has come. */
  begin() {
    performance.mark("cartoloop:joined");
    this.state.begin();
    this.stage.begin();
    this.playback.begin();
    this.suspects.begin();
    this.closure.close();
    this.table.close();
    this.places.show(null);
    this.panel.showFacts(null);
    this.sessions.show([]);
    this.localisation.show();
    this.poseTool.show();
    this.edits.show();
    this.showBefore();
  }

  take(message) {
    if (message.type === Type.HELLO) this.greet(message.content);
    if (message.type === Type.LATEST_CLOSURE) this.noteClosure(message.content);
    if (this.state.take(message)) this.motion.note();
    switch (message.type) {
      case Type.SUBMAP: case Type.SUBMAP_PATCH: case Type.SUBMAP_PREVIEW:
        this.renderer.submaps.take(message);
        break; // drawn when a worker has inflated it
      case Type.READINGS:
        this.panel.show(message.content);
        this.layers.setOver(this.state.isOver);
        this.showBefore();
        this.status.show("connected", message.content);
        this.playback.show();
        break;
      case Type.PLAYBACK: this.playback.show(); break;
      case Type.QUALITY:
        this.places.show(message.content);
        this.stage.change();
        break;
      case Type.FACTS:
        this.panel.showFacts(message.content);
        this.measures.bringBack(message.content);
        break;
      case Type.SESSIONS:
        this.sessions.show(this.state.sessions);
        this.stage.change();
        break;
      case Type.EDITS:
        this.edits.show();
        if (this.state.isComplete) this.noteEdit();
        break;
      case Type.STATES: case Type.LOCALISATION:
        this.localisation.show();
        this.poseTool.show();
        this.marks.show(this.stage.scene(performance.now()));
        this.stage.touch();
        break;
      case Type.SCAN: case Type.PATH: case Type.LATEST_CLOSURE: this.stage.touch(); break;
      case Type.COMPLETE: performance.mark("cartoloop:complete"); // falls through
      default:
        this.playback.show();
        this.stage.change();
    }
  }

  /** The map was edited, here or by another page: what was asked for before is void. */
  noteEdit() {
    this.state.before = null;
    if (this.state.isBefore) this.state.showBefore(false);
    this.showBefore();
    if (this.table.isOpen) this.table.load();
    this.closure.noteEdit();
  }

  greet(hello) {
    if (hello.protocol !== PROTOCOL_VERSION) {
      this.connection.stop();
      this.status.fail(`This page is of another version than ${hello.program}. Please reload it.`);
      return;
    }
    if (this.session !== undefined && this.session !== hello.session) this.camera.forget();
    this.session = hello.session;
    this.theme.colours = hello.colours;
    this.renderer.begin(hello);
    this.renderer.map.colours = this.theme.map;
    document.body.dataset.mode = hello.mode;
    this.panel.begin(hello);
    this.measures.begin(hello.name);
  }

  /** Return where the map is; the facts of a finished one say it best, but not of parts beside it. */
  bounds() {
    const { facts, sessions, submapPoses } = this.state;
    const extent = sessions.every(({ part }) => part === 0) ? facts?.extent : null;
    return extent ?? this.renderer.bounds(submapPoses.rows);
  }

  noteClosure({ submap, node }) {
    const before = this.state.latestClosure;
    const isNew = before?.submap !== submap || before.node !== node;
    if (this.state.isComplete && isNew) this.stage.pulse();
  }

  showView() {
    this.scaleBar.show(this.view, this.layers.on.grid);
    this.measures.draw();
    this.marks.show(this.stage.scene(performance.now()));
    const bounds = this.renderer.bounds(this.state.submapPoses.rows);
    if (bounds !== null) this.camera.limit(bounds);
    const isLost = bounds !== null && !this.view.touches(bounds);
    if (isLost && !this.isLost) this.hint.show("The map is out of sight. Press 0 to see all of it.");
    this.isLost = isLost;
  }

  /** All has been drawn again: what lies over it may have moved. */
  showOver() {
    this.marks.show(this.stage.scene(performance.now()));
    this.scaleBar.show(this.view, this.layers.on.grid);
    const { violated, numRejected } = this.suspects;
    this.panel.showSuspects(violated.size, numRejected);
  }

  changeTheme() {
    if (!this.stage) return;
    this.renderer.map.colours = this.theme.map;
    this.layers.show();
    this.sessions.refresh();
    this.localisation.drawStates();
    this.closure.drawScans();
    this.stage.change();
  }

  // What hands do

  /** @returns {import("./tools.js").Actions} */
  actions() {
    return {
      onView: () => this.move(),
      onZoom: () => this.zoom(),
      openLatest: () => {
        if (this.isLocating) return;
        this.setMeasuring(false);
        this.closure.openLatest();
      },
      fit: () => this.camera.fit(),
      toggleFollow: () => this.camera.setFollowing(!this.camera.isFollowing),
      toggleMeasures: () => this.setMeasuring(!this.measures.isOn),
      finishMeasure: () => this.measures.finish(),
      togglePose: () => this.togglePose(),
      toggleTable: () => this.toggleTable(),
      toggleGrid: () => this.layers.set("grid", !this.layers.on.grid),
      toggleBefore: () => this.toggleBefore(),
      togglePlay: () => this.playback.toggle(),
      toggleTheme: () => this.theme.toggle(),
      saveView: () => savePng(this.canvas, this.title, () => this.stage.drawNow(),
        (context) => this.drawOver(context)),
      saveMap: () => this.saveMap(),
      putAway: () => {
        this.hint.show("");
        if (this.measures.cancel()) return;
        this.setMeasuring(false);
        this.poseTool.toggle(false);
        this.table.close();
        this.closure.close();
      },
    };
  }

  /** @returns {import("./gestures.js").Hands} */
  hands() {
    return {
      onChange: () => this.move(),
      onZoom: () => this.zoom(),
      onPress: (px, py, event) => this.measures.press(px, py) || this.poseTool.press(px, py, event),
      onDrag: (px, py, event) => {
        if (this.poseTool.isOn) this.poseTool.drag(px, py);
        else this.measures.drag(px, py, !event.altKey);
      },
      onRelease: (px, py) => this.poseTool.release(px, py),
      onAbandon: () => this.poseTool.abandon(),
      onHover: (px, py) => this.hover(px, py),
      onClick: (px, py, event) => this.click(px, py, event),
    };
  }

  move() {
    this.camera.take();
    this.stage.handle();
  }

  zoom() {
    this.camera.isPlaced = true;
    this.stage.handle();
  }

  hover(px, py) {
    this.scaleBar.point(this.view.toMap(px, py));
    if (this.measures.isOn) this.measures.hover(px, py);
    else this.canvas.classList.toggle("pointing", this.closureAt(px, py) !== null);
  }

  click(px, py, event) {
    this.tools.closePopovers();
    this.scaleBar.point(this.view.toMap(px, py)); // a finger does not hover
    if (this.measures.isOn) {
      this.measures.click(px, py, !event.altKey);
      return;
    }
    if (this.poseTool.isOn) {
      this.poseTool.click(px, py);
      return;
    }
    const row = this.closureAt(px, py);
    if (row === null) this.closure.close();
    else this.closure.open(row);
  }

  openClosure(row) {
    this.setMeasuring(false);
    this.closure.open(row).then(() => this.closure.bringIntoSight());
  }

  /** Whether a robot is localised in a finished map, which has no closures to look at. */
  get isLocating() {
    return this.state.hello?.mode === "locating";
  }

  togglePose() {
    if (!this.isLocating) return;
    this.setMeasuring(false);
    this.poseTool.toggle();
  }

  /** Show that drags on the map give a pose, or do not. */
  showGiving(isOn) {
    byId("pose-button").setAttribute("aria-pressed", String(isOn));
    byId("pose-button").setAttribute("aria-expanded", String(isOn));
    this.canvas.classList.toggle("giving", isOn);
  }

  toggleTable() {
    if (this.isLocating) return;
    this.setMeasuring(false);
    this.table.toggle();
  }

  /** Go back to how the map was before loop closure, or forth again; the poses are asked for once. */
  async toggleBefore() {
    const { state, stage, motion } = this;
    if (!state.isOver || this.isLocating) return;
    if (state.before === null) {
      try {
        const { submaps, nodes } = await this.connection.ask({ type: "before" });
        state.before = { submaps, nodes };
      } catch (problem) {
        this.hint.show(problem.message);
        return;
      }
    }
    state.showBefore(!state.isBefore);
    this.showBefore();
    motion.note();
    stage.change();
  }

  showBefore() {
    const { isOver, isBefore } = this.state;
    byId("before").hidden = !isOver || this.isLocating;
    byId("before").setAttribute("aria-pressed", String(isBefore));
    byId("before-note").hidden = !isBefore;
  }

  /** Draw into a picture of the screen what is not in its canvas. */
  drawOver(context) {
    const { view, state, scaleBar } = this;
    context.scale(view.ratio, view.ratio);
    this.marks.drawInto(context);
    this.measures.drawInto(context);
    const facts = (state.facts?.described ?? []).map(([name, text]) => `${name} ${text}`).join("   ");
    drawFoot(context, view, {
      title: state.hello?.name ?? "map", facts, metres: scaleBar.metres, length: roundText(scaleBar.metres),
    });
  }

  /** Return the row of the closure that is there on the screen, null if there is none. */
  closureAt(px, py) {
    if (!this.layers.on.closures && !this.layers.on.suspects) return null;
    const scene = this.stage.scene(performance.now());
    return pickClosure(scene, this.stage.overlays.rowsShown(scene), this.view, px, py);
  }

  setMeasuring(isOn) {
    if (isOn === this.measures.isOn) return;
    if (isOn) {
      this.closure.close();
      this.poseTool.toggle(false);
    }
    this.measures.toggle(isOn);
    byId("tape").setAttribute("aria-pressed", String(isOn));
    byId("tape").setAttribute("aria-expanded", String(isOn));
    this.canvas.classList.toggle("measuring", isOn);
  }

  async saveMap() {
    this.hint.show("The map is being drawn.");
    try {
      const { png } = await this.connection.ask({ type: "picture" });
      saveBlob(new Blob([png], { type: "image/png" }), `${this.title}-map.png`);
      this.hint.show("The map is saved.");
    } catch (problem) {
      this.hint.show(problem.message);
    }
  }

  get title() {
    return (this.state.hello?.name ?? "map").replace(/[^\w.-]+/g, "_").slice(0, 80);
  }
}

try {
  if (!globalThis.DecompressionStream) {
    throw new Error("This browser is too old to unpack the map. Please update it.");
  }
  globalThis.cartoloop = inspector(new Page());
} catch (problem) {
  new Status().fail(problem.message);
  throw problem;
}
