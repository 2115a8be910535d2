// SPDX-License-Identifier: Apache-2.0
/**
 * Edits of the map: what was edited, to be undone, where the program was started with --edit.
 * @module
 */
import { byId } from "./dom.js";

/** Shows EDITS, and asks for edits. */
export class Edits {
  /**
   * @param {object} hooks
   * @param {(request: object) => Promise<any>} hooks.ask the server
   * @param {import("./state.js").MapState} hooks.state
   * @param {(text: string) => void} hooks.onHint
   * @param {() => void} hooks.onEdited
   */
  constructor(hooks) {
    this.hooks = hooks;
    this.root = byId("edits");
    this.list = byId("edits-list");
    /** Whether an answer is awaited. */
    this.isBusy = false;
  }

  get canEdit() {
    return this.hooks.state.edits?.can_edit === true;
  }

  show() {
    const { edits } = this.hooks.state;
    this.root.hidden = !edits || edits.edits.length === 0;
    this.list.replaceChildren(...(edits?.edits ?? []).map((edit) => this.row(edit)).reverse());
  }

  row({ edit, what, is_undone: isUndone }) {
    const [row, text] = ["li", "span"].map((tag) => document.createElement(tag));
    text.textContent = `${edit}: ${what}`;
    row.classList.toggle("undone", isUndone);
    row.dataset.edit = String(edit);
    row.append(text);
    if (this.canEdit) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = isUndone ? "Redo" : "Undo";
      button.setAttribute("aria-label", `${button.textContent} edit ${edit}`);
      button.disabled = this.isBusy;
      button.addEventListener("click", () => this.change({ type: isUndone ? "redo_edit" : "undo_edit", edit }));
      row.append(button);
    }
    return row;
  }

  /** Ask for an edit; return whether it was done. @param {object} request */
  async change(request) {
    if (this.isBusy) return false;
    this.setBusy(true);
    this.hooks.onHint("The map is being edited.");
    try {
      const { content } = await this.hooks.ask(request);
      this.hooks.onHint(content.text.split("\n").slice(0, 2).map((line) => line.trim()).join(": "));
      return true;
    } catch (problem) {
      this.hooks.onHint(problem.message);
      return false;
    } finally {
      this.setBusy(false);
      this.hooks.onEdited();
    }
  }

  setBusy(isBusy) {
    this.isBusy = isBusy;
    this.show();
  }
}
