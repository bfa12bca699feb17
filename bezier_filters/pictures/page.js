const data = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id);
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const floats = text => new Float32Array(bytes(text).buffer);
const integers = text => new Uint32Array(bytes(text).buffer);
const number = value => Number.isFinite(value) ? Number(value.toPrecision(3)).toString().replace("-", "\u2212") : "unknown";
const element = (tag, text, parent) => parent.appendChild(Object.assign(document.createElement(tag), {textContent: text}));

// text
document.querySelector("h1").textContent = data.title;
document.querySelector("h1").hidden = !data.title;
data.notes.forEach(note => element("p", note, $("notes")));
data.facts.forEach(row => { const line = element("tr", "", $("facts")); row.forEach(cell => element("td", cell, line)); });
data.findings.forEach(text => element("li", text, $("findings")));

// the picture
const canvas = $("view"), gl = canvas.getContext("webgl2", {antialias: true, preserveDrawingBuffer: true});
if (!gl) { element("p", "This browser cannot draw in three dimensions (WebGL 2).", document.querySelector("main")); throw new Error("no WebGL 2"); }
const VERTEX = `#version 300 es
  in vec3 position, normal; in float value;
  uniform mat3 turn; uniform vec2 zoom, pan; uniform float nearer, size;
  out vec3 seen, towards; out float found;
  void main() {
    seen = turn * position; towards = turn * normal; found = value; gl_PointSize = size;
    gl_Position = vec4(seen.xy * zoom + pan, -0.45 * seen.z - nearer, 1.0);
  }`;
const FRAGMENT = `#version 300 es
  precision highp float;
  in vec3 seen, towards; in float found; out vec4 color;
  uniform sampler2D palette; uniform vec2 limits; uniform vec3 plain; uniform bool mapped, codes, flat_, lit;
  void main() {
    vec3 n = flat_ ? cross(dFdx(seen), dFdy(seen)) : towards;
    n = length(n) > 0.0 ? normalize(n) : vec3(0, 0, 1);
    if (n.z < 0.0) n = -n;
    float t = codes ? (round(found) + 0.5) / 256.0 : clamp((found - limits.x) / (limits.y - limits.x), 0.0, 1.0) * (255.0 / 256.0) + 0.5 / 256.0;
    vec3 base = mapped ? texture(palette, vec2(t, 0.5)).rgb : plain;
    float light = 0.45 + 0.55 * (0.55 * n.z + 0.66 * max(0.0, dot(n, normalize(vec3(-0.6, 0.9, 1.0)))));
    color = vec4(lit ? base * light : base, 1);
  }`;
const program = gl.createProgram();
[[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]].forEach(([kind, text]) => {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, text); gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  gl.attachShader(program, shader);
});
gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST); gl.clearColor(1, 1, 1, 1);
const uniform = name => gl.getUniformLocation(program, name);
const buffer = (target, values) => { const made = gl.createBuffer(); gl.bindBuffer(target, made); gl.bufferData(target, values, gl.STATIC_DRAW); return made; };

// Normals of vertices: sums of those of the faces.
function normals(points, faces) {
  const result = new Float32Array(points.length);
  for (let k = 0; k < faces.length; k += 3) {
    const [a, b, c] = [3 * faces[k], 3 * faces[k + 1], 3 * faces[k + 2]];
    const u = [0, 1, 2].map(i => points[b + i] - points[a + i]), v = [0, 1, 2].map(i => points[c + i] - points[a + i]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const at of [a, b, c]) for (let i = 0; i < 3; i++) result[at + i] += n[i];
  }
  return result;
}
function loaded(mesh) {
  const points = floats(mesh.points), indices = integers(mesh.indices);
  const arrow = mesh.lines ? new Float32Array(points.length) : normals(points, indices);
  return {...mesh, points, indices, count: indices.length, vertices: buffer(gl.ARRAY_BUFFER, points), arrows: buffer(gl.ARRAY_BUFFER, arrow),
    order: buffer(gl.ELEMENT_ARRAY_BUFFER, indices), values: buffer(gl.ARRAY_BUFFER, new Float32Array(points.length / 3))};
}
const meshes = Object.fromEntries(Object.entries(data.meshes).map(([name, mesh]) => [name, loaded(mesh)]));
const sources = data.fields.map(field => floats(field.values));
const errors = data.fields.map(field => field.errors ? floats(field.errors) : null);

// colours
const COOL_WARM = [[59, 77, 191], [230, 230, 230], [191, 5, 38]];
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]];
const blend = (nodes, t) => { const x = t * (nodes.length - 1), k = Math.min(Math.floor(x), nodes.length - 2); return nodes[k].map((low, i) => Math.round(low + (x - k) * (nodes[k + 1][i] - low))); };
const texture = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, texture);
[gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER].forEach(kind => gl.texParameteri(gl.TEXTURE_2D, kind, gl.LINEAR));
[gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T].forEach(kind => gl.texParameteri(gl.TEXTURE_2D, kind, gl.CLAMP_TO_EDGE));

const state = {field: -1, turn: data.turn.slice(), zoom: 1, pan: [0, 0], compare: "", split: 0.5, limits: [0, 1], log: false, creases: false, start: null, line: null};
// Places on the scale: the value itself, or its logarithm both ways from zero, linear up to the median size.
const place = value => { const at = data.fields[state.field].median || 1; return state.log ? Math.sign(value) * Math.log1p(Math.abs(value) / at) : value; };
const value = place_ => { const at = data.fields[state.field].median || 1; return state.log ? Math.sign(place_) * Math.expm1(Math.abs(place_)) * at : place_; };

function choose(index) {
  const field = data.fields[index];
  state.field = index;
  $("field").value = index;
  $("bar").hidden = !field || !!field.names;
  $("names").replaceChildren();
  cut();
  if (!field) { draw(); return; }
  if (!field.names) state.limits = (state.log ? field.range : field.limits).slice();
  const CODES = [[188, 189, 34], [23, 190, 207], [127, 127, 127], [227, 119, 194], [140, 86, 75], [148, 103, 189], [214, 39, 40], [44, 160, 44], [255, 127, 14], [217, 217, 217]];
  const entries = new Uint8Array(4 * 256);
  const nodes = field.signed ? COOL_WARM : VIRIDIS;
  for (let k = 0; k < 256; k++) entries.set([...(field.names ? CODES[Math.min(k, CODES.length - 1)] : blend(nodes, k / 255)), 255], 4 * k);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, entries);
  Object.entries(field.names || {}).filter(([, name]) => name.count).forEach(([code, name]) => {
    const line = element("div", "", $("names"));
    element("span", "", line).style.background = `rgb(${CODES[code]})`;
    line.append(`${name.text}: ${name.count.toLocaleString("en")}`);
  });
  show();
}
function show() {
  const field = data.fields[state.field];
  if (field.names) {
    gl.bindBuffer(gl.ARRAY_BUFFER, meshes.scan.values);
    gl.bufferData(gl.ARRAY_BUFFER, sources[state.field], gl.STATIC_DRAW);
    draw(); return;
  }
  $("unit").textContent = field.unit;
  $("low").value = number(state.limits[0]).replace("\u2212", "-"); $("high").value = number(state.limits[1]).replace("\u2212", "-");
  gl.bindBuffer(gl.ARRAY_BUFFER, meshes.scan.values);
  gl.bufferData(gl.ARRAY_BUFFER, sources[state.field].map(place), gl.STATIC_DRAW);
  histogram(); draw();
}
function histogram() {
  const field = data.fields[state.field], box = $("scale"), ratio = window.devicePixelRatio || 1;
  box.width = box.clientWidth * ratio; box.height = box.clientHeight * ratio;
  const pen = box.getContext("2d"), wide = box.width, tall = box.height, bar = 0.7 * tall, bins = 80, counts = new Array(bins).fill(0);
  const [low, high] = state.limits.map(place);
  for (const found of sources[state.field]) { const k = Math.floor(bins * (place(found) - low) / (high - low)); if (k >= 0 && k < bins) counts[k]++; }
  const most = Math.max(1, ...counts), nodes = field.signed ? COOL_WARM : VIRIDIS;
  pen.clearRect(0, 0, wide, tall); pen.strokeStyle = "#555";
  counts.forEach((count, k) => {
    pen.fillStyle = `rgb(${blend(nodes, (k + 0.5) / bins)})`;
    pen.fillRect(k * wide / bins, 0.5 * tall, wide / bins + 1, 0.2 * tall);
    const height = 0.46 * tall * count / most;
    pen.fillRect(k * wide / bins, 0.46 * tall - height, wide / bins + 1, height);
    if (count) pen.strokeRect(k * wide / bins, 0.46 * tall - height, wide / bins, height);
  });
  pen.fillStyle = "#222"; pen.font = `${13 * ratio}px system-ui, sans-serif`; pen.textBaseline = "top";
  [0, 0.25, 0.5, 0.75, 1].forEach(t => { pen.textAlign = t === 0 ? "left" : t === 1 ? "right" : "center"; pen.fillText(number(value(low + t * (high - low))), t * wide, bar + 4 * ratio); });
}

function paint(mesh, options) {
  gl.uniform3fv(uniform("plain"), options.plain || [0.75, 0.75, 0.75]);
  for (const name of ["mapped", "codes", "flat_", "lit"]) gl.uniform1i(uniform(name), options[name] ? 1 : 0);
  [["position", mesh.vertices, 3], ["normal", mesh.arrows, 3], ["value", mesh.values, 1]].forEach(([name, made, size]) => {
    const at = gl.getAttribLocation(program, name);
    if (at < 0) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, made); gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
  });
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.order);
  const [first, count] = options.part || [0, mesh.count];
  if (mesh.count) gl.drawElements(mesh.lines ? gl.LINES : gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
  else gl.drawArrays(gl.POINTS, 0, mesh.points.length / 3);
}
let wanted = false;
function draw() { if (!wanted) { wanted = true; requestAnimationFrame(render); } }
function render() {
  wanted = false;
  const ratio = window.devicePixelRatio || 1, wide = canvas.width = Math.round(canvas.clientWidth * ratio), tall = canvas.height = Math.round(canvas.clientHeight * ratio);
  const least = Math.min(wide, tall);
  gl.viewport(0, 0, wide, tall); gl.disable(gl.SCISSOR_TEST); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.uniformMatrix3fv(uniform("turn"), true, state.turn);
  gl.uniform2f(uniform("zoom"), 0.95 * state.zoom * least / wide, 0.95 * state.zoom * least / tall);
  gl.uniform1f(uniform("nearer"), 0); gl.uniform1f(uniform("size"), 4 * ratio * Math.sqrt(state.zoom));
  gl.uniform2fv(uniform("pan"), state.pan);
  const other = meshes[state.compare], field = data.fields[state.field];
  if (other) {
    const edge = Math.round(state.split * wide);
    gl.enable(gl.SCISSOR_TEST); gl.scissor(0, 0, edge, tall);
    paint(meshes.scan, {flat_: true, lit: true});
    gl.scissor(edge, 0, wide - edge, tall);
    const old = other.new_from === null ? other.count : other.new_from;
    paint(other, {flat_: true, lit: true, part: [0, old]});
    if (old < other.count) paint(other, {flat_: true, lit: true, plain: [1, 0.6, 0.2], part: [old, other.count - old]});
    gl.scissor(edge - ratio, 0, 2 * ratio, tall); gl.clearColor(0.2, 0.2, 0.2, 1); gl.clear(gl.COLOR_BUFFER_BIT); gl.clearColor(1, 1, 1, 1);
    gl.disable(gl.SCISSOR_TEST);
  } else if (field) {
    gl.uniform2fv(uniform("limits"), field.names ? [0, 1] : state.limits.map(place));
    paint(meshes.scan, {mapped: true, codes: !!field.names, lit: meshes.scan.count > 0});
  } else paint(meshes.scan, {flat_: meshes.scan.count > 0, lit: true});
  const lines = state.creases && !other ? [[meshes.ridges, [0.8, 0.1, 0.1]], [meshes.ravines, [0.1, 0.2, 0.8]]] : [];
  if (state.line && trace.count) lines.push([trace, [0, 0, 0]]);
  lines.forEach(([mesh, plain], k) => {
    gl.uniform1f(uniform("nearer"), 0.004 + 0.001 * k);  // lines lie on the surface; wide ones are several
    for (const [x, y] of mesh ? [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]] : []) {
      gl.uniform2f(uniform("pan"), state.pan[0] + 2 * ratio * x / wide, state.pan[1] + 2 * ratio * y / tall);
      paint(mesh, {plain});
    }
  });
  document.body.dataset.drawn = "yes";
}

// the profile along a line that is drawn on the mesh, which keeps its place when the mesh turns
const trace = {lines: true, count: 0, vertices: gl.createBuffer(), arrows: gl.createBuffer(), order: gl.createBuffer(), values: gl.createBuffer()};
let curves = null;
function cut() {
  const line = state.line, other = meshes[state.compare], field = other ? null : data.fields[state.field];
  $("profile").hidden = !$("cut").checked; $("curve").hidden = $("heights").hidden = !line;
  if (!line) return;
  const valued = field && !field.names, known = valued && errors[state.field];
  const columns = valued ? [sources[state.field], ...(known ? [known] : [])] : [];
  const scan = profile(meshes.scan, line.turn, line.from, line.to, columns), all = [scan];
  if (other) all.push(profile(other, line.turn, line.from, line.to, []));
  const lowest = Math.min(...all.flatMap(it => [...it.heights]).filter(Number.isFinite));
  const heights = all.map(it => it.heights.map(height => (height - lowest) * data.radius)), distances = scan.distances.map(it => it * data.radius);
  curves = {distances, heights, field, values: scan.values};
  $("curve").hidden = !valued;
  $("heights").style.width = valued ? "" : "100%";
  $("read").textContent = "Point at a curve to read it.";
  if (valued) chart($("curve"), `${field.label}${field.unit ? ` [${field.unit}]` : ""}${known ? " and its standard error" : ""}`, distances, [{values: scan.values[0], errors: scan.values[1], color: "#3b4dbf"}], number);
  chart($("heights"), `height over distance [length]${other ? ": before grey, after orange" : ""}`, distances, heights.map((values, k) => ({values, color: k ? "#e67e00" : "#555"})), number);
  traced(scan, line);
}
function traced({distances, heights}, {turn: m, from, to}) {
  const length = distances[distances.length - 1], points = [], order = [];
  distances.forEach((distance, i) => {
    const share = distance / length, seen = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1]), heights[i]];
    for (let k = 0; k < 3; k++) points.push(m[k] * seen[0] + m[3 + k] * seen[1] + m[6 + k] * seen[2]);
    if (Number.isFinite(heights[i]) && Number.isFinite(heights[i - 1])) order.push(i - 1, i);
  });
  for (const [made, values] of [[trace.vertices, points], [trace.arrows, points], [trace.values, heights]]) { gl.bindBuffer(gl.ARRAY_BUFFER, made); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STREAM_DRAW); }
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, trace.order); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(order), gl.STREAM_DRAW);
  trace.count = order.length;
}
// A place of the picture, in pixels of the page, as one of the turned mesh.
function placed(x, y) {
  const wide = canvas.clientWidth, tall = canvas.clientHeight, scale = 0.95 * state.zoom * Math.min(wide, tall);
  return [((2 * x / wide - 1 - state.pan[0]) * wide) / scale, ((1 - 2 * y / tall - state.pan[1]) * tall) / scale];
}
function lined(from, to) { state.line = Math.hypot(to[0] - from[0], to[1] - from[1]) > 1e-4 ? {turn: state.turn.slice(), from, to} : null; cut(); draw(); }
function read(event) {
  const box = event.target, i = Math.round((curves.distances.length - 1) * Math.min(1, Math.max(0, (event.offsetX - 64) / (box.clientWidth - 76))));
  const readings = curves.field && curves.values.length ? [`${curves.field.label} ${curves.values.map(values => number(values[i])).join(" \u00b1 ")} ${curves.field.unit}`] : [];
  $("read").textContent = `At ${number(curves.distances[i])}: ` + [...readings, `height ${curves.heights.map(values => number(values[i])).join(" before, ")}${curves.heights[1] ? " after" : ""}`].join("; ");
}

// what users do
function turned(x, y) {
  const [c, s, d, t] = [Math.cos(x), Math.sin(x), Math.cos(y), Math.sin(y)], m = state.turn;
  const about = [c, 0, s, s * t, d, -c * t, -s * d, t, c * d], result = [];
  for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) result.push([0, 1, 2].reduce((sum, k) => sum + about[3 * i + k] * m[3 * k + j], 0));
  state.turn = result;
}
element("option", "shape", $("field")).value = -1;
data.fields.forEach((field, k) => { element("option", field.label + (field.unit ? ` [${field.unit}]` : ""), $("field")).value = k; });
element("option", "off", $("compare")).value = "";
data.comparisons.forEach(([name, text]) => { element("option", text, $("compare")).value = name; });
const compare = name => {
  state.compare = name; $("compare").value = name; $("split").hidden = !name;
  $("comparison-note").textContent = (data.comparisons.find(([other]) => other === name) || ["", "", ""])[2]; cut(); draw();
};
$("comparison").hidden = !data.comparisons.length; $("known").hidden = !data.facts.length; $("cutting").hidden = !meshes.scan.count;
$("lines").hidden = !meshes.ridges && !meshes.ravines;
$("field").onchange = event => { if (state.compare) compare(""); choose(Number(event.target.value)); };
$("compare").onchange = event => compare(event.target.value);
$("split").oninput = event => { state.split = Number(event.target.value); draw(); };
$("log").onchange = event => { state.log = event.target.checked; choose(state.field); };
$("creases").onchange = event => { state.creases = event.target.checked; draw(); };
["low", "high"].forEach((id, k) => { $(id).onchange = event => {
  const limits = state.limits.slice(); limits[k] = Number(event.target.value);
  if (limits[0] < limits[1]) state.limits = limits;
  show();
}; });
$("cut").onchange = event => { canvas.style.cursor = event.target.checked ? "crosshair" : ""; state.line = null; cut(); draw(); };
["curve", "heights"].forEach(id => { $(id).onpointermove = read; });
canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); state.start = placed(event.offsetX, event.offsetY); };
canvas.onpointermove = event => {
  if (!event.buttons) return;
  if ($("cut").checked && state.start && !event.shiftKey && event.buttons === 1) { lined(state.start, placed(event.offsetX, event.offsetY)); return; }
  const size = Math.min(canvas.clientWidth, canvas.clientHeight);
  if (event.shiftKey || event.buttons === 4) { state.pan[0] += 2 * event.movementX / canvas.clientWidth; state.pan[1] -= 2 * event.movementY / canvas.clientHeight; }
  else turned(4 * event.movementX / size, 4 * event.movementY / size);
  draw();
};
canvas.addEventListener("wheel", event => { event.preventDefault(); state.zoom *= Math.exp(-0.001 * event.deltaY); draw(); }, {passive: false});
canvas.ondblclick = () => { Object.assign(state, {turn: data.turn.slice(), zoom: 1, pan: [0, 0], line: null}); cut(); draw(); };
window.onresize = () => { if (data.fields[state.field] && !data.fields[state.field].names) histogram(); cut(); draw(); };
// A link may say what is shown: #field=0&turn=40&tilt=-10&compare=smoothed&creases&profile=0.2,0.5,0.8,0.5
const asked = new URLSearchParams(location.hash.slice(1));
turned(Number(asked.get("turn") || 0) * Math.PI / 180, Number(asked.get("tilt") || 0) * Math.PI / 180);
if (asked.has("log")) { state.log = $("log").checked = true; }
if (asked.has("creases")) { state.creases = $("creases").checked = true; }
if (asked.has("split")) { state.split = Number(asked.get("split")); $("split").value = state.split; }
choose(asked.has("field") ? Number(asked.get("field")) : data.fields.length ? 0 : -1);
compare(asked.get("compare") || "");
if (asked.has("profile")) {
  const [a, b, c, d] = asked.get("profile").split(",").map(Number);
  $("cut").checked = true; cut();
  const [wide, tall] = [canvas.clientWidth, canvas.clientHeight];
  lined(placed(a * wide, b * tall), placed(c * wide, d * tall));
}
