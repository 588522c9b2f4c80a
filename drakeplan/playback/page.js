// Plays the plans of a page: one time bar, keys, a camera that follows, captions, colours of forces, torque bars.
// #plan-data holds what Python computed (page_data.py); meshcat holds the scene and its animation.
// The address can say: #t=3.5 stops there, &speed=0.5, &follow, &supports=0, &forces=0, &torques=0, &still (no panels), &bare (no legend).
"use strict";
(function () {
  const page = JSON.parse(document.getElementById("plan-data").textContent);
  const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
  const JUST_AFTER = 1e-3; // [s] after a change, so that what it brought is in the picture
  const NEAR = 4.0; // [m] at most from the camera that follows to the robot
  const BARS = 12; // joints that are listed
  const PATIENCE = 100; // [ms] between two orders of the list, to be readable
  const ROOM_FOR_BARS = 700, ROOM_FOR_LEGEND = 500; // [px] width of a view below which the list starts hidden, the legend folded

  const wanted = new URLSearchParams(location.hash.slice(1));
  for (const name of ["still", "bare"]) if (wanted.has(name)) document.body.classList.add(name);
  const find = (part) => document.querySelector("#plan-time " + part);
  const [bar, slider, clock, play, speed] = [document.getElementById("plan-time"),
    ...["input[type=range]", ".clock", ".play", ".speed"].map(find)];
  const boxes = Object.fromEntries(["follow", "supports", "forces", "torques"].map((name) => [name, find("." + name + " input")]));

  // ---- what each view shows

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const last = (times, t) => { // row that holds at t, -1 where there is none
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t + 1e-6) low = middle + 1; else high = middle;
    }
    return times.length ? Math.max(low - 1, 0) : -1;
  };
  const colour = (percent) => page.palette[Math.min(percent, page.palette.length - 1)];

  const views = page.plans.map((plan, k) => {
    const pane = document.querySelectorAll(".plan-pane")[k];
    return {
      plan, pane, viewer: (window.planViewers || [viewer])[k],
      used: plan.forces && plan.forces.used.map(bytes),
      share: plan.torques && bytes(plan.torques.share),
      time: pane.querySelector(".plan-caption b"), holds: pane.querySelector(".plan-caption span"),
      list: pane.querySelector(".plan-torques"), rows: [], listed: -1e9, said: "",
    };
  });
  const lead = views.reduce((a, b) => (b.plan.duration > a.plan.duration ? b : a)); // its clock is the page's
  const animator = () => lead.viewer.animator;
  const moments = [0, ...new Set(views.flatMap((v) => v.plan.changes)), lead.plan.duration].sort((a, b) => a - b);

  const caption = (view, phase, knot) => {
    const { phases, effectors, stances, timed } = view.plan;
    const holds = phases.held[phase].map((e) => ({
      name: effectors[e].replace("_", " "), percent: view.used && knot >= 0 ? view.used[e][knot] : null }));
    const said = JSON.stringify([phase, holds]);
    if (said === view.said) return;
    view.said = said;
    const parts = [`${timed ? " · " : ""}${stances ? `stance ${phases.stance[phase]} of ${stances} · ` : ""}`];
    for (const { name, percent } of holds) {
      if (parts.length > 1) parts.push(percent === null ? ", " : " ");
      if (percent !== null) {
        const dot = document.createElement("i");
        dot.style.background = colour(percent);
        parts.push(dot);
      }
      parts.push(name);
    }
    if (!holds.length) parts.push("no contact");
    view.holds.replaceChildren(...parts);
  };

  const paint = (view, knot) => {
    view.plan.effectors.forEach((name, e) => {
      if (!view.plan.phases.held.some((held) => held.includes(e))) return;
      const css = colour(view.used[e][knot]);
      view.viewer.scene_tree.find([...page.forces, name]).object.traverse((part) => {
        if (part.material && part.material.color) part.material.color.set(css);
      });
    });
  };

  const list = (view, t) => {
    const { names, rate } = view.plan.torques, count = names.length;
    const first = Math.min(Math.floor(t * rate + 1e-6), view.share.length / count - 1) * count;
    const order = names.map((_, joint) => joint).sort((a, b) => view.share[first + b] - view.share[first + a] || a - b);
    while (view.rows.length < Math.min(BARS, count)) {
      const row = document.createElement("div");
      row.append(...["i", "span", "b"].map((tag) => document.createElement(tag)));
      view.list.append(row);
      view.rows.push(row.children);
    }
    view.rows.forEach(([fill, name, number], k) => {
      const percent = view.share[first + order[k]];
      fill.style.width = Math.min(percent, 100) + "%";
      fill.style.background = colour(percent);
      name.textContent = names[order[k]].replaceAll("_", " ");
      number.textContent = percent + " %";
    });
  };

  const show = (view, time) => {
    const { plan } = view, t = Math.min(time, plan.duration);
    view.time.textContent = plan.timed ? t.toFixed(1) + " s" : "";
    const phase = last(plan.phases.t, t), knot = plan.forces ? last(plan.forces.t, t) : -1;
    if (phase >= 0) caption(view, phase, knot);
    if (knot >= 0) paint(view, knot);
    if (view.share && boxes.torques.checked && (!animator().playing || Math.abs(performance.now() - view.listed) > PATIENCE)) {
      view.listed = performance.now();
      list(view, t);
    }
  };

  // ---- time

  const seek = (time) => {
    const t = Math.min(Math.max(time, 0), animator().duration);
    for (const { viewer: v } of views) {
      v.animator.pause();
      v.animator.seek(t);
    }
    animator().display_progress(t);
  };
  const toggle = () => (animator().playing ? animator().pause() : animator().play());
  const step = (way) => {
    const now = animator().time;
    const next = way > 0 ? moments.find((m) => m > now + JUST_AFTER / 2) : moments.findLast((m) => m < now - 2 * JUST_AFTER);
    const there = next === undefined ? now : next;
    seek(there > 0 && there < lead.plan.duration ? there + JUST_AFTER : there);
  };
  const go = (rate) => { animator().mixer.timeScale = Math.min(Math.max(rate, SPEEDS[0]), SPEEDS.at(-1)); };
  const faster = () => go(SPEEDS.find((s) => s > animator().mixer.timeScale + 1e-6) ?? SPEEDS.at(-1));
  const slower = () => go(SPEEDS.findLast((s) => s < animator().mixer.timeScale - 1e-6) ?? SPEEDS[0]);

  // ---- cameras

  let touched = views[0]; // the view whose camera leads where two are linked
  for (const view of views) {
    const canvas = view.viewer.dom_element;
    for (const event of ["pointerdown", "wheel"]) canvas.addEventListener(event, () => { touched = view; }, { passive: true });
  }
  const centre = (view) => view.viewer.scene_tree.find(page.com).object.getWorldPosition(view.viewer.camera.position.clone());
  const follow = () => {
    for (const view of views.filter((v) => v.plan.timed)) {
      const { camera, controls } = view.viewer;
      if (boxes.follow.checked) {
        view.before = { position: camera.position.clone(), target: controls.target.clone() };
        view.centre = centre(view);
        const away = camera.position.clone().sub(controls.target).clampLength(0, NEAR);
        controls.target.copy(view.centre);
        camera.position.copy(view.centre).add(away);
      } else if (view.before) {
        camera.position.copy(view.before.position);
        controls.target.copy(view.before.target);
        view.before = view.centre = null;
      }
      view.viewer.set_dirty();
    }
  };
  const move = () => {
    for (const view of views) {
      if (!view.centre) continue;
      const now = centre(view), moved = now.clone().sub(view.centre);
      if (moved.lengthSq() === 0) continue;
      view.viewer.camera.position.add(moved);
      view.viewer.controls.target.add(moved);
      view.centre = now;
      view.viewer.set_dirty();
    }
    if (views.length < 2 || !(page.linked || boxes.follow.checked)) return;
    const other = views.find((v) => v !== touched).viewer, { camera, controls } = touched.viewer;
    const target = boxes.follow.checked ? other.controls.target.clone() : controls.target;
    const position = camera.position.clone().sub(controls.target).add(target);
    if (other.camera.position.distanceTo(position) + other.controls.target.distanceTo(target) < 1e-9) return;
    other.camera.position.copy(position);
    other.controls.target.copy(target);
    other.set_dirty();
  };

  // ---- buttons and keys

  const layers = () => {
    for (const { viewer: v, pane } of views) {
      v.set_property(page.supports, "visible", boxes.supports.checked);
      v.set_property(page.forces, "visible", boxes.forces.checked);
      pane.classList.toggle("listing", boxes.torques.checked);
      v.set_dirty();
    }
    shown = NaN;
  };
  for (const name of ["supports", "forces", "torques"]) boxes[name].onchange = layers;
  boxes.follow.onchange = follow;
  play.onclick = toggle;
  slider.oninput = () => seek(parseFloat(slider.value));
  find(".previous").onclick = () => step(-1);
  find(".next").onclick = () => step(1);
  find(".slower").onclick = slower;
  find(".faster").onclick = faster;
  bar.addEventListener("click", (event) => { if (event.detail) document.activeElement.blur(); }); // keys stay the page's
  const keys = { " ": toggle, ArrowLeft: () => step(-1), ArrowRight: () => step(1), "+": faster, "=": faster, "-": slower,
    f: () => boxes.follow.disabled || boxes.follow.click() };
  addEventListener("keydown", (event) => {
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key], at = event.target;
    const typing = at.matches && at.matches("input:not([type=range]):not([type=checkbox]), textarea, select");
    const presses = event.key === " " && at.matches && at.matches("button, input[type=checkbox]");
    if (!act || typing || presses || event.ctrlKey || event.altKey || event.metaKey || bar.hidden) return;
    event.preventDefault();
    if (!event.repeat || event.key.startsWith("Arrow")) act();
  }, true);

  let shown = NaN, seen = "";
  const tick = () => {
    const { time, playing } = animator();
    if (time !== shown) {
      for (const view of views) {
        if (view !== lead) view.viewer.animator.seek(time);
        show(view, time);
      }
      shown = time;
    }
    move();
    if (document.activeElement !== slider || playing) slider.value = time;
    const state = [time.toFixed(1), playing, animator().mixer.timeScale].join();
    if (state !== seen) {
      seen = state;
      clock.textContent = lead.plan.timed ? `${time.toFixed(1)} / ${lead.plan.duration.toFixed(1)} s` : "";
      play.classList.toggle("playing", playing);
      speed.textContent = +animator().mixer.timeScale.toFixed(2) + "\u00d7";
    }
    requestAnimationFrame(tick);
  };
  const make_room = () => document.body.style.setProperty("--bar", bar.offsetHeight + "px");

  const wait = setInterval(() => {
    if (views.some(({ plan, viewer: v }) => plan.phases.t.length && !v.animator.actions.length)) return;
    clearInterval(wait);
    if (!lead.plan.phases.t.length) return;
    slider.max = animator().duration;
    bar.hidden = false;
    make_room();
    addEventListener("resize", make_room);
    const any = (test) => views.some(test);
    boxes.follow.disabled = !any((v) => v.plan.timed);
    for (const [name, has] of [["follow", any((v) => v.plan.timed)], ["forces", any((v) => v.used)], ["torques", any((v) => v.share)]])
      boxes[name].parentElement.hidden = !has;
    for (const name of ["supports", "forces"]) boxes[name].checked = wanted.get(name) !== "0";
    boxes.torques.checked = wanted.has("torques") ? wanted.get("torques") !== "0" : views[0].pane.offsetWidth >= ROOM_FOR_BARS;
    for (const { pane, plan } of views) {
      pane.querySelector(".plan-legend").open = pane.offsetWidth >= ROOM_FOR_LEGEND;
      pane.querySelector(".plan-caption").hidden = !plan.phases.t.length;
    }
    layers();
    const plays = lead.plan.timed && !wanted.has("t");
    for (const { viewer: v } of views) v.animator.play(); // poses show only of what has been played
    seek(parseFloat(wanted.get("t")) || 0);
    if (wanted.has("speed")) go(parseFloat(wanted.get("speed")) || 1);
    if (wanted.has("follow")) keys.f();
    if (plays) toggle();
    tick();
  }, 20);
})();
