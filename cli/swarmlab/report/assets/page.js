"use strict";
(() => {
  const TRAIL_MS = 8000;
  const NEAR_PX = 14;
  const PLACES = [[10, 4], [10, -5], [10, 13], [-10, 4], [-10, -5], [-10, 13], [18, -14], [18, 22], [-18, -14], [-18, 22]];
  const element = (id) => document.getElementById(id);
  const map = element("map");
  const drawn = (name, kind, parent) => {
    const node = document.createElementNS(map.namespaceURI, name);
    node.setAttribute("class", kind);
    parent.append(node);
    return node;
  };
  const numbers = (text) => (text || "").split(" ").map(Number);
  const seconds = (ms) => (ms / 1000).toFixed(1) + " s";

  // ---- the recording: differences back to positions in cm
  const recording = JSON.parse(element("replay").textContent);
  for (const vehicle of recording.vehicles) {
    for (const piece of vehicle.pieces) {
      for (const key of ["x", "y", "z", "h"]) {
        let sum = 0;
        piece[key] = piece[key].map((difference) => (sum += difference));
      }
    }
  }

  /** Position at an instant in metres and degrees, straight lines between samples; null in a hole. */
  function position(vehicle, ms) {
    const index = ms / recording.step_ms;
    for (const piece of vehicle.pieces) {
      const at = index - piece.at;
      const last = piece.x.length - 1;
      if (at < 0 || at > last + 0.5) continue;
      const low = Math.min(Math.floor(at), last);
      const high = Math.min(low + 1, last);
      const share = Math.min(at - low, 1);
      const between = (key) => piece[key][low] + share * (piece[key][high] - piece[key][low]);
      return { x: between("x") / 100, y: between("y") / 100, z: between("z") / 100, h: between("h") };
    }
    return null;
  }

  function blocks(vehicle, ms) {
    return vehicle.blocks.filter(([start, end]) => start <= ms && ms < end).map((block) => block[2]).join(", ");
  }

  function described(vehicle, ms) {
    const here = position(vehicle, ms);
    if (!here) return `${vehicle.name} at ${seconds(ms)}: no position`;
    const doing = blocks(vehicle, ms);
    return `${vehicle.name} at ${seconds(ms)}: ${here.x.toFixed(1)} m east, ${here.y.toFixed(1)} m north, ` +
      `${here.z.toFixed(1)} m high${doing ? ", in " + doing : ""}`;
  }

  // ---- tooltips: titles become one tooltip of the page
  const tip = element("tip");
  for (const title of document.querySelectorAll("svg title")) {
    title.parentNode.dataset.tip = title.textContent;
    title.remove();
  }

  function show(text, event) {
    tip.textContent = text;
    tip.hidden = false;
    const left = Math.min(event.clientX + 14, window.innerWidth - tip.offsetWidth - 8);
    const above = event.clientY - tip.offsetHeight - 12;
    tip.style.left = Math.max(4, left) + "px";
    tip.style.top = (above > 4 ? above : event.clientY + 18) + "px";
  }

  function inChart(svg, event) {
    return new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  }

  let lit = null;
  function light(series) {
    if (lit) lit.classList.remove("lit");
    lit = series;
    if (lit) lit.classList.add("lit");
  }

  // ---- charts over time
  const charts = [...document.querySelectorAll("svg.time")].map((svg) => {
    const [t0, t1] = numbers(svg.dataset.t);
    const [x0, x1] = numbers(svg.dataset.x);
    const series = [...svg.querySelectorAll("path.series")].map((path) => ({
      path,
      pieces: path.getAttribute("d").split("M").filter(Boolean).map((piece) => piece.split("L").map(numbers)),
    }));
    const cursor = drawn("line", "cursor", svg);
    cursor.setAttribute("y1", svg.dataset.top);
    cursor.setAttribute("y2", String(svg.viewBox.baseVal.height - 38));
    return { svg, series, cursor, time: (x) => t0 + (x - x0) / (x1 - x0) * (t1 - t0), x: (t) => x0 + (t - t0) / (t1 - t0) * (x1 - x0), x0, x1 };
  });

  function height(pieces, x) {
    for (const piece of pieces) {
      if (x < piece[0][0] || x > piece[piece.length - 1][0]) continue;
      let low = 0;
      let high = piece.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (piece[middle][0] <= x) low = middle; else high = middle;
      }
      const [xa, ya] = piece[low];
      const [xb, yb] = piece[high];
      return xb > xa ? ya + (x - xa) / (xb - xa) * (yb - ya) : ya;
    }
    return null;
  }

  function value(svg, y) {
    const [v0, v1] = numbers(svg.dataset.v);
    const [y0, y1] = numbers(svg.dataset.y);
    const share = (y - y0) / (y1 - y0);
    return svg.dataset.axis === "log" ? v0 * Math.pow(v1 / v0, share) : v0 + share * (v1 - v0);
  }

  for (const chart of charts) {
    chart.svg.addEventListener("pointermove", (event) => {
      const at = inChart(chart.svg, event);
      let best = null;
      if (at.x >= chart.x0 && at.x <= chart.x1) {
        for (const one of chart.series) {
          const y = height(one.pieces, at.x);
          if (y !== null && (!best || Math.abs(y - at.y) < Math.abs(best.y - at.y))) best = { one, y };
        }
      }
      if (best) {
        light(best.one.path);
        show(`${best.one.path.dataset.name}: ${value(chart.svg, best.y).toPrecision(3)} ${chart.svg.dataset.unit} at ${chart.time(at.x).toFixed(1)} s`, event);
        event.stopPropagation();
      }
    });
    chart.svg.addEventListener("click", (event) => {
      const at = inChart(chart.svg, event);
      if (at.x >= chart.x0 && at.x <= chart.x1) seek(chart.time(at.x) * 1000);
    });
  }
  document.addEventListener("pointermove", (event) => {
    const holder = event.target instanceof Element ? event.target.closest("[data-tip]") : null;
    light(holder && holder.classList.contains("series") ? holder : null);
    if (holder) show(holder.dataset.tip, event);
    else tip.hidden = true;
  });
  document.addEventListener("pointerleave", () => { tip.hidden = true; light(null); });

  // ---- the map and its vehicles
  const frame = Object.fromEntries(["west", "north", "left", "top", "scale"].map((key) => [key, Number(map.dataset[key])]));
  const px = (x) => frame.left + (x - frame.west) * frame.scale;
  const py = (y) => frame.top + (frame.north - y) * frame.scale;
  const trails = recording.vehicles.map((vehicle) => drawn("path", `trail ${vehicle.kind}`, map));
  const names = recording.vehicles.map((vehicle) => {
    const name = drawn("text", "vehiclename", map);
    name.textContent = vehicle.name;
    return name;
  });
  const bodies = recording.vehicles.map((vehicle) => {
    const body = drawn("path", `vehicle ${vehicle.kind}`, map);
    body.setAttribute("d", vehicle.kind === "uav" ? "M9 0L-6 6L-3 0L-6 -6Z" : "M8 0L3 5L-7 5L-7 -5L3 -5Z");
    return body;
  });

  function nearest(event) {
    const at = inChart(map, event);
    let best = null;
    for (const vehicle of recording.vehicles) {
      for (const piece of vehicle.pieces) {
        for (let i = 0; i < piece.x.length; i++) {
          const away = Math.hypot(px(piece.x[i] / 100) - at.x, py(piece.y[i] / 100) - at.y);
          if (away < NEAR_PX && (!best || away < best.away)) best = { vehicle, away, ms: (piece.at + i) * recording.step_ms };
        }
      }
    }
    return best;
  }

  map.addEventListener("pointermove", (event) => {
    const holder = event.target.closest(".obstacle, .start, .end");
    const body = bodies.indexOf(event.target);
    const found = holder || body >= 0 ? null : nearest(event);
    if (body >= 0) show(described(recording.vehicles[body], now), event);
    else if (found) {
      light([...map.querySelectorAll("path.series")].find((path) => path.dataset.name === found.vehicle.name));
      show(described(found.vehicle, found.ms), event);
    } else return;
    event.stopPropagation();
  });
  map.addEventListener("click", (event) => {
    const found = nearest(event);
    if (found) seek(found.ms);
  });

  // ---- the player
  const player = element("player");
  const slider = element("time");
  const button = element("play");
  const speed = element("speed");
  let now = 0;
  let playing = false;
  let before = 0;

  /** Names beside their vehicles; one that would cover another name or vehicle is not shown. */
  function placeNames(shown) {
    const taken = shown.map(({ x, y }) => [x - 7, y - 6, x + 9, y + 6]);
    for (const { name, x, y } of shown) {
      const wide = 7 * name.textContent.length;
      const found = PLACES.map(([dx, dy]) => [dx < 0 ? x + dx - wide : x + dx, y + dy])
        .find(([left, base]) => taken.every((box) => left >= box[2] || left + wide <= box[0] || base - 9 >= box[3] || base + 2 <= box[1]));
      name.style.display = found ? "" : "none";
      if (!found) continue;
      const [left, base] = found;
      taken.push([left, base - 9, left + wide, base + 2]);
      name.setAttribute("x", left.toFixed(1));
      name.setAttribute("y", base.toFixed(1));
    }
  }

  function draw() {
    const shown = [];
    recording.vehicles.forEach((vehicle, i) => {
      const here = position(vehicle, now);
      for (const node of [bodies[i], names[i], trails[i]]) node.style.display = here ? "" : "none";
      if (!here) return;
      const x = px(here.x);
      const y = py(here.y);
      bodies[i].setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${(-here.h).toFixed(0)})`);
      shown.push({ name: names[i], x, y });
      const trail = [];
      for (let ms = Math.max(0, now - TRAIL_MS); ms < now; ms += Math.max(200, recording.step_ms)) {
        const was = position(vehicle, ms);
        if (was) trail.push(`${px(was.x).toFixed(1)} ${py(was.y).toFixed(1)}`);
      }
      trail.push(`${x.toFixed(1)} ${y.toFixed(1)}`);
      trails[i].setAttribute("d", "M" + trail.join("L"));
    });
    placeNames(shown);
    for (const chart of charts) {
      const x = chart.x(now / 1000).toFixed(1);
      chart.cursor.setAttribute("x1", x);
      chart.cursor.setAttribute("x2", x);
    }
    slider.value = String(now);
    slider.setAttribute("aria-valuetext", seconds(now));
    element("clock").textContent = seconds(now);
  }

  function seek(ms) {
    now = Math.min(Math.max(ms, 0), recording.end_ms);
    map.classList.add("replayed");
    draw();
  }

  function play(on) {
    playing = on;
    button.textContent = on ? "❚❚ pause" : "▶ play";
    button.setAttribute("aria-pressed", String(on));
    if (!on) return;
    if (now >= recording.end_ms) now = 0;
    before = performance.now();
    requestAnimationFrame(step);
  }

  function step(at) {
    if (!playing) return;
    seek(now + Math.max(0, at - before) * Number(speed.value));
    before = at;
    if (now >= recording.end_ms) play(false);
    else requestAnimationFrame(step);
  }

  function faster(by) {
    speed.selectedIndex = Math.min(Math.max(speed.selectedIndex + by, 0), speed.options.length - 1);
  }

  const KEYS = {
    " ": () => play(!playing),
    k: () => play(!playing),
    ArrowLeft: (event) => seek(now - (event.shiftKey ? 10000 : 1000)),
    ArrowRight: (event) => seek(now + (event.shiftKey ? 10000 : 1000)),
    Home: () => seek(0),
    End: () => seek(recording.end_ms),
    "-": () => faster(-1),
    "+": () => faster(1),
  };
  // everywhere for space, + and -; the other keys scroll the page, so they act within the player and the map only
  const ANYWHERE = new Set([" ", "k", "-", "+"]);
  document.addEventListener("keydown", (event) => {
    const target = event.target;
    if (event.ctrlKey || event.altKey || event.metaKey || !KEYS[event.key]) return;
    if (target === speed || (event.key === " " && target.closest("button, a"))) return;
    if (!ANYWHERE.has(event.key) && !target.closest("#player, .scroll")) return;
    event.preventDefault();
    KEYS[event.key](event);
  });

  if (recording.vehicles.some((vehicle) => vehicle.pieces.length)) {
    slider.max = String(recording.end_ms);
    slider.addEventListener("input", () => seek(Number(slider.value)));
    button.addEventListener("click", () => play(!playing));
    player.hidden = false;
    draw();
    // `report.html#t=36` opens at that second
    const asked = /^#t=([0-9.]+)$/.exec(location.hash);
    if (asked) seek(Number(asked[1]) * 1000);
  }
})();
