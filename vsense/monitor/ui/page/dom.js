// Small helpers for the page's elements. Nothing here ever sets HTML from a message.

/** @template {string} Id @param {Id} id @returns {ElementOf<Id>} */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`there is no element #${id}`);
  return /** @type {any} */ (element);
}

/** All elements that a selector finds.
 * @param {string} selector @returns {HTMLElement[]} */
export const elements = (selector) => [.../** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(selector))];

/** The first element inside another that a selector finds.
 * @param {ParentNode} parent @param {string} selector @returns {HTMLElement} */
export function inside(parent, selector) {
  const element = parent.querySelector(selector);
  if (!(element instanceof HTMLElement)) throw new Error(`there is no ${selector}`);
  return element;
}

/** What draws on a canvas.
 * @param {HTMLCanvasElement} canvas @param {CanvasRenderingContext2DSettings} [settings] @returns {Pen} */
export function penOf(canvas, settings) {
  const pen = canvas.getContext("2d", settings);
  if (!pen) throw new Error("this browser draws no canvases");
  return pen;
}

/** Makes an element: make("td", { className: "n" }, "text", child, ...).
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag @param {Partial<HTMLElementTagNameMap[Tag]>} properties @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[Tag]} */
export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Sets an element's text where it differs: unchanged text costs no layout.
 * @param {Element} element @param {unknown} text */
export function write(element, text) {
  const wanted = String(text);
  if (element.textContent !== wanted) element.textContent = wanted;
}

/** Sets or removes a class where it differs.
 * @param {Element} element @param {string} name @param {unknown} on */
export function mark(element, name, on) {
  if (element.classList.contains(name) !== Boolean(on)) element.classList.toggle(name, Boolean(on));
}

/** Says whether a button is pressed in.
 * @param {Element} button @param {boolean} on */
export function press(button, on) {
  const text = on ? "true" : "false";
  if (button.getAttribute("aria-pressed") !== text) button.setAttribute("aria-pressed", text);
}

/** Gives a canvas as many pixels as it has on the screen; tells whether that was new.
 * @param {HTMLCanvasElement} canvas */
export function fit(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width === width && canvas.height === height) return false;
  canvas.width = width;
  canvas.height = height;
  return true;
}

/** What was chosen on this machine before; a browser without storage chooses anew each time.
 * @param {string} name @param {string} otherwise */
export function remembered(name, otherwise) {
  try {
    return localStorage.getItem(`vsense.${name}`) ?? otherwise;
  } catch {
    return otherwise;
  }
}

/** @param {string} name @param {string | boolean} value */
export function remember(name, value) {
  try {
    localStorage.setItem(`vsense.${name}`, String(value));
  } catch {
    // Private windows have no storage; the choice then lasts as long as the page.
  }
}
