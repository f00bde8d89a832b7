"use strict";
// Sections fold and unfold; what is printed or pointed to is open.
(() => {
  const sections = [...document.querySelectorAll("main > section > details")];
  document.querySelectorAll("[data-fold]").forEach((button) =>
    button.addEventListener("click", () => sections.forEach((part) => { part.open = button.dataset.fold === "open"; })));
  const reveal = () => {
    const part = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const folded = part && part.querySelector(":scope > details");
    if (folded) folded.open = true;
  };
  document.querySelectorAll(".contents a").forEach((link) => link.addEventListener("click", () => setTimeout(reveal)));
  addEventListener("hashchange", reveal);
  reveal();
  let folded = [];
  addEventListener("beforeprint", () => { folded = sections.filter((p) => !p.open); folded.forEach((p) => { p.open = true; }); });
  addEventListener("afterprint", () => folded.forEach((p) => { p.open = false; }));
  const cue = (table) => table.classList.toggle("cut", table.scrollWidth > table.clientWidth + 1);
  const watch = new ResizeObserver((entries) => entries.forEach((entry) => cue(entry.target)));
  document.querySelectorAll(".wide").forEach((table) => watch.observe(table));
  const contents = document.querySelector(".contents");
  if (contents && matchMedia("(max-width: 50rem)").matches) contents.open = false;
})();
