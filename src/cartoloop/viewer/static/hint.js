// SPDX-License-Identifier: Apache-2.0
/**
 * Words that come and go.
 * @module
 */
import { byId, setText } from "./dom.js";

const SHOWN_MS = 6000;

/** Shows what to do next, or what has been done. */
export class Hint {
  constructor() {
    this.element = byId("hint");
  }

  /** @param {string} text "" for none */
  show(text) {
    clearTimeout(this.timer);
    this.element.hidden = text === "";
    setText(this.element, text);
    if (text) this.timer = setTimeout(() => this.show(""), SHOWN_MS);
  }
}
