// Small helpers for the page's elements. Nothing here ever sets HTML from a message.

export const byId = (id) => document.getElementById(id);

/** Makes an element: make("td", { className: "n" }, "text", child, ...). */
export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Sets an element's text where it differs: unchanged text costs no layout. */
export function write(element, text) {
  const wanted = String(text);
  if (element.textContent !== wanted) element.textContent = wanted;
}

/** Sets or removes a class where it differs. */
export function mark(element, name, on) {
  if (element.classList.contains(name) !== Boolean(on)) element.classList.toggle(name, Boolean(on));
}

/** Says whether a button is pressed in. */
export function press(button, on) {
  const text = on ? "true" : "false";
  if (button.getAttribute("aria-pressed") !== text) button.setAttribute("aria-pressed", text);
}

/** Gives a canvas as many pixels as it has on the screen; tells whether that was new. */
export function fit(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width === width && canvas.height === height) return false;
  canvas.width = width;
  canvas.height = height;
  return true;
}

/** What was chosen on this machine before; a browser without storage chooses anew each time. */
export function remembered(name, otherwise) {
  try {
    return localStorage.getItem(`vsense.${name}`) ?? otherwise;
  } catch {
    return otherwise;
  }
}

export function remember(name, value) {
  try {
    localStorage.setItem(`vsense.${name}`, value);
  } catch {
    // Private windows have no storage; the choice then lasts as long as the page.
  }
}
