// SPDX-License-Identifier: Apache-2.0
/**
 * The page: what comes from the server is kept, what changes is drawn, what hands do is done.
 * For tests, and for who looks into the page with the browser's tools, see inspect.js.
 * @module
 */
import { Camera } from "./camera.js";
import { ClosureCard, pickClosure } from "./closure.js";
import { Connection, socketUrl } from "./connection.js";
import { byId } from "./dom.js";
import { Gestures } from "./gestures.js";
import { Renderer } from "./gl/renderer.js";
import { Hint } from "./hint.js";
import { inspector } from "./inspect.js";
import { Layers } from "./layers.js";
import { Motion } from "./motion.js";
import { Panel } from "./panel.js";
import { Places } from "./places.js";
import { PlaybackBar } from "./playback.js";
import { PROTOCOL_VERSION, Type } from "./protocol.js";
import { saveBlob, savePng } from "./save.js";
import { ScaleBar } from "./scale_bar.js";
import { Stage } from "./stage.js";
import { MapState } from "./state.js";
import { Status } from "./status.js";
import { Tape } from "./tape.js";
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
    this.hint = new Hint();
    this.scaleBar = new ScaleBar();
    this.panel = new Panel();
    this.theme = new Theme(() => this.changeTheme());
    this.layers = new Layers(this.theme, change);
    this.renderer = new Renderer(this.canvas, this.view, () => {
      this.tape?.refresh();
      this.stage?.schedule();
    });
    this.camera = new Camera(this.view, {
      bounds: () => this.renderer.bounds(this.state.submapPoses.rows),
      isFinished: () => this.state.readings?.state === "finished",
      isCalm: () => this.motion.calm.matches,
      onMove: () => this.stage?.schedule(),
      onShown: () => this.showView(),
    });
    const hooks = {
      state: this.state, theme: this.theme, onChange: change,
      ask: (request) => this.connection.ask(request),
      send: (request) => this.connection.send(request),
      onHint: (text) => this.hint.show(text),
      onShow: (bounds) => this.camera.look(bounds),
      levelsAround: (point, reach) => this.renderer.work.levelsAround(point, reach),
    };
    this.playback = new PlaybackBar(hooks);
    this.closure = new ClosureCard(hooks);
    this.places = new Places(hooks.onShow);
    this.tape = new Tape(byId("tape-layer"), this.view, hooks);
    this.stage = new Stage(this);
    this.tools = new Tools(this.view, this.actions());
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
    this.closure.close();
    this.places.show(null);
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
        this.status.show("connected", message.content);
        this.playback.show();
        break;
      case Type.PLAYBACK: this.playback.show(); break;
      case Type.QUALITY:
        this.places.show(message.content);
        this.stage.change();
        break;
      case Type.SCAN: case Type.LATEST_CLOSURE: this.stage.touch(); break;
      case Type.COMPLETE: performance.mark("cartoloop:complete"); // falls through
      default:
        this.playback.show();
        this.stage.change();
    }
  }

  greet(hello) {
    if (hello.protocol !== PROTOCOL_VERSION) {
      this.connection.stop();
      this.status.fail(`This page is of another version than ${hello.program}. Please reload it.`);
      return;
    }
    if (this.session !== undefined && this.session !== hello.session) this.camera.forget();
    this.session = hello.session;
    this.theme.palette = hello.palette;
    this.renderer.begin(hello);
    this.renderer.map.colours = this.theme.map;
    this.panel.begin(hello);
  }

  noteClosure({ submap, node }) {
    const before = this.state.latestClosure;
    const isNew = before?.submap !== submap || before.node !== node;
    if (this.state.isComplete && isNew) this.stage.pulse();
  }

  showView() {
    this.scaleBar.show(this.view);
    this.tape.draw();
    const bounds = this.renderer.bounds(this.state.submapPoses.rows);
    const isLost = bounds !== null && !this.view.touches(bounds);
    if (isLost && !this.isLost) this.hint.show("The map is out of sight. Press 0 to see all of it.");
    this.isLost = isLost;
  }

  changeTheme() {
    if (!this.stage) return;
    this.renderer.map.colours = this.theme.map;
    this.layers.show();
    this.closure.drawScans();
    this.stage.change();
  }

  // What hands do

  /** @returns {import("./tools.js").Actions} */
  actions() {
    return {
      onView: () => this.move(),
      onZoom: () => this.zoom(),
      openLatest: () => this.closure.openLatest(),
      fit: () => this.camera.fit(),
      toggleFollow: () => this.camera.setFollowing(!this.camera.isFollowing),
      toggleTape: () => this.setTape(!this.tape.isOn),
      togglePlay: () => this.playback.toggle(),
      toggleTheme: () => this.theme.toggle(),
      saveView: () => savePng(this.canvas, this.title, () => this.stage.drawNow(),
        (context) => this.tape.drawInto(context)),
      saveMap: () => this.saveMap(),
      putAway: () => {
        this.setTape(false);
        this.closure.close();
        this.hint.show("");
      },
    };
  }

  /** @returns {import("./gestures.js").Hands} */
  hands() {
    return {
      onChange: () => this.move(),
      onZoom: () => this.zoom(),
      onPress: (px, py) => this.tape.press(px, py),
      onDrag: (px, py, event) => this.tape.drag(px, py, !event.altKey),
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
    if (this.tape.isOn) this.tape.hover(px, py);
    else this.canvas.classList.toggle("pointing", this.closureAt(px, py) !== null);
  }

  click(px, py, event) {
    this.tools.closePopovers();
    if (this.tape.isOn) {
      this.tape.click(px, py, !event.altKey);
      return;
    }
    const row = this.closureAt(px, py);
    if (row === null) this.closure.close();
    else this.closure.open(row);
  }

  /** Return the row of the closure that is there on the screen, null if there is none. */
  closureAt(px, py) {
    if (!this.layers.on.closures) return null;
    const scene = this.stage.scene(performance.now());
    return pickClosure(scene, this.stage.overlays.rowsShown(scene), this.view, px, py);
  }

  setTape(isOn) {
    if (isOn === this.tape.isOn) return;
    this.tape.toggle(isOn);
    byId("tape").setAttribute("aria-pressed", String(isOn));
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
