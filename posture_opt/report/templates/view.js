// The arm in 3-D, drawn by plotly.js: a posture is chosen from the list, in a table, or by its point.
(async () => {
  const view = document.getElementById("arm-view");
  const find = (selector) => view.querySelector(selector);
  const unpacked = async (id) => {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const webgl = document.createElement("canvas").getContext("webgl");
  if (!webgl || typeof DecompressionStream === "undefined") return;
  const library = document.createElement("script");
  library.textContent = await unpacked("view-library");
  document.head.append(library);
  const data = JSON.parse(await unpacked("view-data"));
  const plot = find(".plot");
  const COLOURS = data.colours, HIGHLIGHT = "#d55e00";
  const shown = { region: true, budget: false, obstacles: true };
  let at = 0;

  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const moved = (T, x, y, z) => [
    T[0] * x + T[1] * y + T[2] * z + T[3], T[4] * x + T[5] * y + T[6] * z + T[7], T[8] * x + T[9] * y + T[10] * z + T[11]];
  // A mesh with its corners moved by one transform, or each by that of its frame.
  const placed = (mesh, of) => {
    const found = { x: [], y: [], z: [], i: mesh.i, j: mesh.j, k: mesh.k };
    mesh.x.forEach((x, c) => {
      const [a, b, d] = moved(of(c), x, mesh.y[c], mesh.z[c]);
      found.x.push(a); found.y.push(b); found.z.push(d);
    });
    return found;
  };
  const blend = (share) => {
    const t = Math.max(0, Math.min(1, share)), from = [221, 226, 231], to = [213, 94, 0];
    return `rgb(${from.map((c, k) => Math.round(c + t * (to[k] - c))).join(",")})`;
  };
  const solid = { type: "mesh3d", flatshading: false, hoverinfo: "skip", showscale: false,
    lighting: { ambient: 0.55, diffuse: 0.75, specular: 0.12, roughness: 0.6, fresnel: 0.05 },
    lightposition: { x: -2000, y: -4000, z: 9000 } };
  const lines = (points, look) => ({ type: "scatter3d", mode: "lines", hoverinfo: "skip", showlegend: false,
    x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]), line: look });

  const arm = (posture) => {
    const shares = new Map(posture.shares), marks = new Map(posture.marks);
    const largest = Math.max(...shares.values(), 1e-9);
    const colour = data.arm.parts.map((part) => {
      if (shown.budget && part.role !== "base") return blend((shares.get(part.name) || 0) / largest);
      if (marks.has(part.name) && (part.role === "joint" || part.role === "base" || part.role === "tool")) return HIGHLIGHT;
      return COLOURS[part.role];
    });
    return { ...solid, ...placed(data.arm, (c) => posture.frames[data.arm.frame[c]]), facecolor: data.arm.part.map((p) => colour[p]) };
  };
  const ring = (T) => Array.from({ length: 49 }, (_, k) => moved(T, 1000 * Math.cos(k * Math.PI / 24), 1000 * Math.sin(k * Math.PI / 24), 0));
  const box = ([low, high]) => {
    const corner = (c) => [0, 1, 2].map((k) => (c >> k & 1 ? high : low)[k]);
    const gap = [null, null, null];
    return [0, 1, 2, 3, 4, 5, 6, 7].flatMap((c) => [1, 2, 4].filter((b) => !(c & b)).flatMap((b) => [corner(c), corner(c | b), gap]));
  };
  const points = () => {
    const tools = data.postures.map((p) => p.frames[p.frames.length - 1]);
    const valued = data.postures.some((p) => p.value !== null);
    return { type: "scatter3d", mode: data.line ? "lines+markers" : "markers", showlegend: false,
      x: tools.map((T) => T[3]), y: tools.map((T) => T[7]), z: tools.map((T) => T[11]),
      customdata: data.postures.map((p) => p.key), hovertext: data.postures.map((p) => plain(p.label)), hoverinfo: "text",
      line: { color: "#a8a8a8", width: 2 },
      marker: { size: data.postures.map((_, k) => (k === at ? 9 : 5)), line: { color: "#000", width: 1 },
        color: valued ? data.postures.map((p) => p.value) : "#0072b2", colorscale: "Cividis", showscale: valued,
        colorbar: { title: { text: plain(data.values), side: "right" }, thickness: 12, len: 0.7 } } };
  };
  const joints = (posture) => {
    const middles = data.joints.map((j) => moved(posture.frames[j.frame], ...j.middle));
    const value = new Map(posture.facts);
    return { type: "scatter3d", mode: "markers", showlegend: false, hoverinfo: "text",
      hovertext: data.joints.map((j) => plain(`${j.name}: ${value.get(j.name)}`)),
      x: middles.map((p) => p[0]), y: middles.map((p) => p[1]), z: middles.map((p) => p[2]), marker: { size: 14, opacity: 0, color: "#000" } };
  };
  const traces = () => {
    const posture = data.postures[at];
    const tool = posture.frames[posture.frames.length - 1];
    const found = [arm(posture)];
    data.around.forEach((body) => {
      if (body.role === "floor" || shown.obstacles)
        found.push({ ...solid, ...placed(body, () => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]), color: COLOURS[body.role], flatshading: true,
          opacity: body.role === "floor" ? 1 : 0.6, hoverinfo: body.role === "floor" ? "skip" : "text", hovertext: plain(body.name) });
    });
    if (posture.region && shown.region)
      found.push({ ...solid, ...placed(data.shapes.ball, () => posture.region), color: COLOURS.region, opacity: 0.6, hoverinfo: "text", hovertext: plain(data.region) });
    if (posture.arrow) found.push({ ...solid, ...placed(data.shapes.arrow, () => posture.arrow), color: COLOURS.direction });
    if (posture.ring && shown.region) found.push(lines(ring(posture.ring.axes), { color: COLOURS.ring, width: 6 }));
    if (data.box) found.push(lines(box(data.box), { color: "#767676", width: 3, dash: "dash" }));
    if (posture.missed) found.push({ ...lines([posture.missed]), mode: "markers", marker: { symbol: "x", size: 6, color: COLOURS.missed } });
    if (data.points) found.push(points());
    found.push(joints(posture));
    found.push({ ...lines([[tool[3], tool[7], tool[11]]]), mode: "markers", marker: { size: 4, color: "#000" } });
    return found;
  };
  // Where a point [mm] is seen in the drawing, in pixels from its middle.
  const seen = (point) => {
    const { eye, center } = camera, unit = (v) => v.map((c) => c / Math.hypot(...v));
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const dot = (a, b) => a.reduce((sum, c, k) => sum + c * b[k], 0);
    const ahead = unit([center.x - eye.x, center.y - eye.y, center.z - eye.z]);
    const right = unit(cross(ahead, [0, 0, 1])), up = cross(right, ahead);
    const from = point.map((c, k) => 1.25 * (c - (data.low[k] + data.high[k]) / 2) / longest - [eye.x, eye.y, eye.z][k]);
    const scale = plot.clientHeight / 2 / Math.tan(Math.PI / 8) / dot(from, ahead);
    return [scale * dot(from, right), -scale * dot(from, up)];
  };
  // Callouts in a column at the edge that is nearer to what they name; in a narrow window numbers, and the texts in the panel.
  const callouts = (told) => {
    const size = 12, narrow = plot.clientWidth < 560, high = plot.clientHeight / 2;
    const half = (data.values ? 0.4 : 0.5) * plot.clientWidth; // the scale of the values stands beside the scene
    const list = find(".callouts");
    list.replaceChildren(...(narrow ? told : []).map(({ text }) => { const item = document.createElement("li"); item.textContent = text; return item; }));
    const placed = told.map((label, k) => ({ ...label, text: narrow ? String(k + 1) : label.text, seen: seen(label.at) })).sort((a, b) => a.seen[1] - b.seen[1]);
    const left = data.values || placed.reduce((sum, { seen: [x] }) => sum + x, 0) < 0;
    let free = -high + 30;
    return placed.map(({ text, color, at: [x, y, z], seen: [sx, sy] }) => {
      const height = 8 + 1.35 * size * text.split("\n").length, top = Math.max(free, sy - height / 2);
      free = top + height + 6;
      return { x, y, z, text: plain(text).replace(/\n/g, "<br>"), align: "left", showarrow: true, arrowhead: 0, arrowwidth: 1, arrowcolor: color,
        ax: (left ? 6 - half : half - 6) - sx, ay: top + height / 2 - sy, font: { color, size }, bgcolor: "rgba(255,255,255,0.85)", bordercolor: color, borderpad: 2,
        xanchor: left ? "left" : "right" };
    });
  };
  const labels = () => {
    const posture = data.postures[at], frames = posture.frames;
    const spot = (owner) => {
      const joint = data.joints.find((j) => j.name === owner);
      return joint ? moved(frames[joint.frame], ...joint.middle) : moved(frames[owner === "tool" ? frames.length - 1 : 0], 0, 0, 0);
    };
    let told = posture.marks.map(([owner, text]) => ({ text, color: HIGHLIGHT, at: spot(owner) }));
    if (shown.budget) told = posture.shares.filter(([, share]) => share >= 0.01)
      .map(([owner, share]) => ({ text: `${owner} ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`, color: "#7a3600", at: spot(owner) }));
    else if (shown.region && !told.length) {
      if (posture.region) told.push({ text: data.region, color: "#7a5200", at: moved(posture.region, 0, 0, 0) });
      if (posture.ring) told.push({ text: posture.ring.label, color: "#00664b", at: ring(posture.ring.axes)[0] });
    }
    const found = callouts(told.slice(0, 3));
    if (shown.obstacles) data.around.filter((body) => body.role === "obstacle").forEach((body) => {
      const top = body.z.indexOf(Math.max(...body.z));
      found.push({ x: body.x[top], y: body.y[top], z: body.z[top], text: plain(body.name), showarrow: false, yshift: 10, font: { color: "#a04500", size: 12 } });
    });
    return found;
  };
  const spans = [0, 1, 2].map((k) => data.high[k] - data.low[k]);
  const longest = Math.max(...spans);
  const axis = (name, k) => ({ title: { text: `${name} [mm]` }, range: [data.low[k], data.high[k]], backgroundcolor: "#fff", gridcolor: "#ddd", zeroline: false, nticks: spans[k] < 0.2 * longest ? 2 : 6, showspikes: false, visible: !(data.planar && name === "z") });
  view.classList.add("drawn");
  let camera;
  const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((i) => ((k >> i) & 1 ? data.high : data.low)[i]));
  // From a direction, so far off that the box is seen with the numbers and names of its axes, which stand outside of it.
  const fitted = (direction) => {
    const unit = (v) => v.map((c) => c / Math.hypot(...v)), vector = ([x, y, z]) => ({ x, y, z });
    const wide = plot.clientWidth, high = plot.clientHeight, beside = wide < 560 ? 54 : 60;
    const free = { left: beside, right: beside + (data.values ? 0.2 * wide : 0), top: beside, bottom: beside };
    const back = unit(direction), right = unit([-back[1], back[0], 0]);
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    let away = 1.25 * Math.hypot(...spans) / longest, middle = [0, 0, 0];
    for (let round = 0; round < 12; round++) {
      camera = { eye: vector(middle.map((c, k) => c + away * back[k])), center: vector(middle), up: { x: 0, y: 0, z: 1 } };
      const corners = CORNERS.map(seen), ends = [0, 1].map((k) => corners.map((at) => at[k])).map((at) => [Math.min(...at), Math.max(...at)]);
      const pixels = high / 2 / Math.tan(Math.PI / 8) / away, [x, y] = ends.map(([low, top]) => (low + top) / 2);
      const off = [x - (free.left - free.right) / 2, y - (free.top - free.bottom) / 2].map((c) => c / pixels);
      middle = middle.map((c, k) => c + off[0] * right[k] - off[1] * up[k]);
      away *= Math.max((ends[0][1] - ends[0][0]) / (wide - free.left - free.right), (ends[1][1] - ends[1][0]) / (high - free.top - free.bottom));
    }
    return camera;
  };
  const start = fitted(data.eye);
  const layout = () => ({ margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "#fff", font: { size: 12 },
    scene: { xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2), aspectmode: "manual",
      aspectratio: { x: 1.25 * spans[0] / longest, y: 1.25 * spans[1] / longest, z: 1.25 * spans[2] / longest }, camera, annotations: labels(), dragmode: "turntable" } });
  const config = { displaylogo: false, responsive: true, showTips: false, displayModeBar: plot.clientWidth > 560, modeBarButtons: [["toImage", "zoom3d", "pan3d", "tableRotation"]] };

  const rows = () => document.querySelectorAll("main [data-view]");
  const tell = () => {
    const posture = data.postures[at];
    const list = find(".shown");
    list.replaceChildren(...posture.facts.flatMap(([label, value]) => {
      const term = document.createElement("dt"), said = document.createElement("dd");
      term.textContent = label; said.textContent = value;
      return [term, said];
    }));
    find("#posture").value = posture.key;
    view.dataset.shown = posture.key;
    rows().forEach((row) => { if (row.dataset.view === posture.key) row.setAttribute("aria-current", "true"); else row.removeAttribute("aria-current"); });
  };
  const draw = async () => {
    if (plot._fullLayout && plot._fullLayout.scene) camera = plot._fullLayout.scene._scene.getCamera();
    await Plotly.react(plot, traces(), layout(), config);
  };
  const choose = async (k) => { at = (k + data.postures.length) % data.postures.length; tell(); await draw(); };
  const named = (key) => data.postures.findIndex((posture) => posture.key === key);

  tell();
  await Plotly.newPlot(plot, traces(), layout(), config);
  const has = (what, there) => { if (!there) find(`.switches .${what}`).remove(); };
  has("region", data.region); has("budget", data.postures.some((p) => p.shares.length)); has("obstacles", data.around.some((b) => b.role === "obstacle"));
  if (data.region) find(".region-label").textContent = data.region;
  if (data.postures.length < 2) find(".choose").remove();
  else {
    find("#posture").addEventListener("change", (event) => choose(named(event.target.value)));
    view.querySelectorAll("[data-step]").forEach((button) => button.addEventListener("click", () => choose(at + Number(button.dataset.step))));
  }
  view.querySelectorAll("[data-show]").forEach((box) => box.addEventListener("change", () => { shown[box.dataset.show] = box.checked; draw(); }));
  rows().forEach((row) => row.addEventListener("click", (event) => {
    event.stopPropagation();
    choose(named(row.dataset.view));
    view.scrollIntoView({ block: "nearest" });
  }));
  plot.on("plotly_click", (event) => { const key = event.points[0].customdata; if (key !== undefined && named(key) >= 0) choose(named(key)); });
  const look = (to) => { camera = to; return Plotly.relayout(plot, { "scene.camera": to }); };
  const LOOKS = { start: data.eye, x: [1, 0, 0.02], y: [0, -1, 0.02], z: [0, -0.01, 1] };
  view.querySelectorAll("[data-look]").forEach((button) => button.addEventListener("click", () => look(fitted(LOOKS[button.dataset.look]))));
  find(".stage").addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.15], ArrowDown: [0, -0.15] }[event.key];
    const scale = { "+": 0.9, "-": 1.1 }[event.key];
    if (!step && !scale) return;
    event.preventDefault();
    const now = plot._fullLayout.scene._scene.getCamera(), about = now.center, x = now.eye.x - about.x, y = now.eye.y - about.y, z = now.eye.z - about.z;
    const r = Math.hypot(x, y, z) * (scale || 1), [turn, rise] = step || [0, 0];
    const around = Math.atan2(y, x) + turn, up = Math.max(-1.5, Math.min(1.5, Math.asin(z / Math.hypot(x, y, z)) + rise));
    look({ ...now, eye: { x: about.x + r * Math.cos(up) * Math.cos(around), y: about.y + r * Math.cos(up) * Math.sin(around), z: about.z + r * Math.sin(up) } });
  });
  view.dataset.ready = "true";
})();
