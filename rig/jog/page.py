"""The preview page, its script and its style: nothing is fetched from elsewhere, and text enters the page as text."""

from __future__ import annotations

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>rig preview</title>
<link rel="stylesheet" href="/page.css">
</head>
<body>
<header><b id="state">connecting</b> <span id="pose"></span></header>
<main><img id="picture" alt="The camera's newest picture"></main>
<footer><span id="measures"></span><span id="trouble"></span></footer>
<script src="/page.js"></script>
</body>
</html>
"""

STYLE = """
html, body { height: 100%; margin: 0; }
body { display: flex; flex-direction: column; background: #14171a; color: #e6e6e6; }
body { font: 16px/1.5 system-ui, sans-serif; font-variant-numeric: tabular-nums; }
header, footer { display: flex; flex-wrap: wrap; gap: 0 1.5rem; padding: .4rem .8rem; }
header { background: #20262b; }
main { flex: 1; min-height: 0; display: flex; align-items: center; justify-content: center; }
img { max-width: 100%; max-height: 100%; object-fit: contain; }
.old img { opacity: .35; }
#state { text-transform: uppercase; }
#trouble { color: #ffb38a; }
"""

# A picture is asked for when the last one has come: a slow browser gets fewer, and never old ones.
SCRIPT = """
"use strict";
const picture = document.getElementById("picture");
const show = (id, text) => { document.getElementById(id).textContent = text; };
const later = (what, ms) => setTimeout(what, ms);
let number = 0;

function ask() { picture.src = "/picture.jpg?" + (number += 1); }
picture.onload = () => later(ask, 100);
picture.onerror = () => later(ask, 1000);

async function look() {
  try {
    const answer = await fetch("/status.json", { credentials: "same-origin", cache: "no-store" });
    if (!answer.ok) { throw new Error(await answer.text()); }
    const told = await answer.json();
    for (const id of ["state", "pose", "measures", "trouble"]) { show(id, told[id]); }
    document.body.className = told.old ? "old" : "";
    later(look, 500);
  } catch (error) {
    show("state", "no answer");
    show("trouble", error instanceof TypeError ? "rig jog has ended, or does not answer" : error.message);
    document.body.className = "old";
    later(look, 2000);
  }
}

async function start() {
  const token = location.hash.slice(1);
  if (token) {
    await fetch("/session", { headers: { "X-Rig-Token": token }, credentials: "same-origin", cache: "no-store" });
    history.replaceState(null, "", "/");
  }
  ask();
  look();
}
start();
"""
