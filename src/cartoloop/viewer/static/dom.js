// SPDX-License-Identifier: Apache-2.0
/**
 * Small help with elements. What is shown is always set as text, never as HTML.
 * @module
 */

/** @param {string} id @returns {any} the element of that id */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return element;
}

/** Set the text of an element, if it has changed, so that screen readers do not read it twice. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/**
 * Return a new element for a drawing.
 * @param {SVGElement} drawing
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {Node[]} children
 */
export function svg(drawing, name, attributes, children = []) {
  const element = document.createElementNS(drawing.namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  element.append(...children);
  return element;
}

/**
 * Return the value that is stored under a name, if there is one and it can be read.
 * @param {"localStorage" | "sessionStorage"} [place] where; to ask for it may already be forbidden
 */
export function stored(key, fallback, place = "localStorage") {
  try {
    return JSON.parse(globalThis[place].getItem(key)) ?? fallback;
  } catch {
    return fallback;
  }
}

/** Store a value, where the browser allows it. */
export function store(key, value, place = "localStorage") {
  try {
    globalThis[place].setItem(key, JSON.stringify(value));
  } catch {
    // A browser that stores nothing forgets the choice with the page: no harm is done.
  }
}
