// What all scripts of the page use: elements, numbers as text, and files.
'use strict';
const $ = id => document.getElementById(id);

const made = (kind, attributes = {}, ...children) => {
  const made = document.createElement(kind);
  Object.assign(made, attributes);
  made.append(...children);
  return made;
};

const written = value => typeof value !== 'number' ? String(value ?? '–') : String(Number(value.toPrecision(4)));

// Shows a reason at its field, or removes it.
const tellWrong = (id, reason) => {
  const place = $(`${id}-wrong`);
  if (!place) return;
  place.textContent = reason ?? '';
  place.hidden = !reason;
  $(id).setAttribute('aria-invalid', String(Boolean(reason)));
};

// Loads a script next to the page. Unlike fetch, this works from a folder as well as from a server.
const scripts = new Map();
const script = file => {
  const load = () => new Promise((resolve, reject) => {
    const place = made('script', {src: file});
    place.addEventListener('load', resolve);
    place.addEventListener('error', () => {
      // The next attempt loads it anew.
      scripts.delete(file);
      place.remove();
      reject(new Error(`The file ${file} can't be loaded. It must be in the folder of this page.`));
    });
    document.head.append(place);
  });
  if (!scripts.has(file)) scripts.set(file, load());
  return scripts.get(file);
};

// Gives a file to the user.
const download = (name, type, content) => {
  const link = made('a', {href: URL.createObjectURL(new Blob([content], {type})), download: name});
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};

const copied = async text => {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
};
