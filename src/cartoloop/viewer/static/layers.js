// SPDX-License-Identifier: Apache-2.0
/**
 * The choice of what is drawn over the map, and what its colours mean.
 * @module
 */
import { byId, store, stored } from "./dom.js";
import { LAYERS } from "./overlays.js";

const LAYERS_KEY = "cartoloop.chosen-layers";
const COLOURING_KEY = "cartoloop.colouring";

/** What is drawn over the map, as the operator chose it. */
export class Layers {
  /** @param {import("./theme.js").Theme} theme @param {() => void} onChange */
  constructor(theme, onChange) {
    this.theme = theme;
    this.onChange = onChange;
    /** What the operator has switched. @type {Record<string, boolean>} */
    this.chosen = stored(LAYERS_KEY, {});
    this.on = { ...LAYERS, ...this.chosen };
    /** @type {"kind" | "residual"} */
    this.colouring = stored(COLOURING_KEY, "kind") === "residual" ? "residual" : "kind";
    for (const box of document.querySelectorAll("[data-layer]")) {
      box.checked = this.on[box.dataset.layer];
      box.addEventListener("change", () => this.set(box.dataset.layer, box.checked));
    }
    for (const choice of document.querySelectorAll("[name=colouring]")) {
      choice.checked = choice.value === this.colouring;
      choice.addEventListener("change", () => {
        this.colouring = choice.value;
        store(COLOURING_KEY, this.colouring);
        this.show();
        onChange();
      });
    }
    this.show();
  }

  /** Switch a layer, for this time and later ones. */
  set(layer, isOn) {
    this.chosen[layer] = this.on[layer] = isOn;
    store(LAYERS_KEY, this.chosen);
    document.querySelector(`[data-layer=${layer}]`).checked = isOn;
    this.onChange();
  }

  /** Loop closures are of interest while they come; over a finished map thousands hide it. */
  setOver(isOver) {
    if (this.isOver === isOver) return;
    this.isOver = isOver;
    this.on.closures = this.chosen.closures ?? !isOver;
    document.querySelector("[data-layer=closures]").checked = this.on.closures;
    this.onChange();
  }

  /** Show the colours of the theme. */
  show() {
    const { inks } = this.theme;
    for (const swatch of document.querySelectorAll("[data-ink]")) {
      swatch.style.setProperty("--swatch", `rgb(${inks[swatch.dataset.ink].join(" ")})`);
    }
    byId("legend-kind").hidden = this.colouring !== "kind";
    byId("legend-residual").hidden = this.colouring !== "residual";
    const context = byId("ramp").getContext("2d");
    const { width, height } = context.canvas;
    for (let x = 0; x < width; x++) {
      context.fillStyle = `rgb(${this.theme.residual(x / (width - 1)).join(" ")})`;
      context.fillRect(x, 0, 1, height);
    }
  }
}
