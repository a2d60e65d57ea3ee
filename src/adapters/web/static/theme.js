// Before the page is drawn: the reader's choice of dark or light, if there is one.
"use strict";
try {
  const chosen = localStorage.getItem("theme");
  if (chosen === "dark" || chosen === "light") document.documentElement.dataset.theme = chosen;
} catch (_) { /* storage switched off: the system's setting stands */ }
