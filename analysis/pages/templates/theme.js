// Light or dark, as the reader says or else as the system does. The choice is kept where the browser allows it.
(() => {
  "use strict";
  const KEY = "mccd-colours", root = document.documentElement;
  const recall = () => { try { return localStorage.getItem(KEY); } catch { return null; } };
  const keep = (value) => { try { localStorage.setItem(KEY, value); } catch { /* shown all the same, for this visit */ } };
  const show = (value) => { if (value === "light" || value === "dark") root.dataset.colours = value; else delete root.dataset.colours; };
  show(recall()); // before anything is drawn
  addEventListener("DOMContentLoaded", () => {
    const label = document.querySelector(".colours"), select = label.querySelector("select");
    select.value = root.dataset.colours || "system";
    select.addEventListener("change", () => { show(select.value); keep(select.value); });
    label.hidden = false;
  });
})();
