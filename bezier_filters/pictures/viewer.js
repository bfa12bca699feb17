"use strict";
// The picture of meshes: WebGL 2, a camera, and what lies under a place of the picture.
const data = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id);
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const floats = text => new Float32Array(bytes(text).buffer);
const integers = text => new Uint32Array(bytes(text).buffer);

const canvas = $("view"), gl = canvas.getContext("webgl2", {antialias: true});
if (!gl) {
  $("reading").textContent = "This browser cannot draw in three dimensions (WebGL 2).";
  throw new Error("no WebGL 2");
}
const VERTEX = `#version 300 es
  in vec3 position, normal; in float value, exact, error;
  uniform mat3 turn; uniform vec2 zoom, pan; uniform float nearer, size, linear_below;
  out vec3 seen, towards, place; out float found, read, spread, unknown; flat out float code;
  void main() {
    seen = turn * position; towards = turn * normal; place = position;
    read = exact; spread = error; code = exact; unknown = value > 1e29 ? 1.0 : 0.0;
    found = linear_below > 0.0 ? sign(value) * log(1.0 + abs(value) / linear_below) : value;
    gl_PointSize = size;
    gl_Position = vec4(seen.xy * zoom + pan, -0.45 * seen.z - nearer, 1.0);
  }`;
const FRAGMENT = `#version 300 es
  precision highp float;
  in vec3 seen, towards; in float found, unknown; flat in float code; out vec4 color;
  uniform sampler2D palette; uniform vec2 limits; uniform vec3 plain, back; uniform bool mapped, codes, flat_, lit;
  void main() {
    vec3 n = flat_ ? cross(dFdx(seen), dFdy(seen)) : towards;
    n = length(n) > 0.0 ? normalize(n) : vec3(0, 0, 1);
    if (n.z < 0.0) n = -n;
    float share = clamp((found - limits.x) / (limits.y - limits.x), 0.0, 1.0);
    float t = codes ? (round(code) + 0.5) / 256.0 : share * (255.0 / 256.0) + 0.5 / 256.0;
    vec3 base = mapped && unknown == 0.0 ? texture(palette, vec2(t, 0.5)).rgb : lit && !gl_FrontFacing ? back : plain;
    float light = 0.45 + 0.55 * (0.55 * n.z + 0.66 * max(0.0, dot(n, normalize(vec3(-0.6, 0.9, 1.0)))));
    color = vec4(lit ? base * light : base, 1);
  }`;
// bits of single precision numbers: place in the mesh, then value and standard error
const PICK = `#version 300 es
  precision highp float; precision highp int;
  in vec3 place; in float read, spread;
  layout(location = 0) out uvec4 where; layout(location = 1) out uvec4 what;
  void main() { where = uvec4(floatBitsToUint(place), 1u); what = uvec4(floatBitsToUint(vec2(read, spread)), 0u, 0u); }`;

const ATTRIBUTES = ["position", "normal", "value", "exact", "error"];
function program_of(fragment) {
  const made = gl.createProgram();
  [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]].forEach(([kind, text]) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  });
  ATTRIBUTES.forEach((name, at) => gl.bindAttribLocation(made, at, name));
  gl.linkProgram(made);
  const places = {};
  return {made, uniform: name => places[name] ??= gl.getUniformLocation(made, name)};
}
const painter = program_of(FRAGMENT), picker = program_of(PICK);
gl.enable(gl.DEPTH_TEST);
const buffer = (target, values) => {
  const made = gl.createBuffer();
  gl.bindBuffer(target, made); gl.bufferData(target, values, gl.STATIC_DRAW);
  return made;
};

// Normals of vertices: sums of those of the faces.
function normals(points, faces) {
  const result = new Float32Array(points.length);
  for (let k = 0; k < faces.length; k += 3) {
    const a = 3 * faces[k], b = 3 * faces[k + 1], c = 3 * faces[k + 2];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    result[a] += x; result[a + 1] += y; result[a + 2] += z;
    result[b] += x; result[b + 1] += y; result[b + 2] += z;
    result[c] += x; result[c + 1] += y; result[c + 2] += z;
  }
  return result;
}
function loaded(mesh) {
  const points = floats(mesh.points), indices = integers(mesh.indices);
  const arrows = mesh.normals ? floats(mesh.normals) : mesh.lines ? new Float32Array(points.length) : normals(points, indices);
  return {...mesh, arrows, points, indices, count: indices.length, position: buffer(gl.ARRAY_BUFFER, points),
    normal: buffer(gl.ARRAY_BUFFER, arrows), order: buffer(gl.ELEMENT_ARRAY_BUFFER, indices)};
}
const meshes = Object.fromEntries(Object.entries(data.meshes).map(([name, mesh]) => [name, loaded(mesh)]));
const sources = data.fields.map(field => floats(field.values));
const errors = data.fields.map(field => field.errors ? floats(field.errors) : null);
const shades = data.fields.map((field, k) => field.shades ? floats(field.shades) : sources[k]);
const texture = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, texture);
[gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER].forEach(kind => gl.texParameteri(gl.TEXTURE_2D, kind, gl.LINEAR));
[gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T].forEach(kind => gl.texParameteri(gl.TEXTURE_2D, kind, gl.CLAMP_TO_EDGE));

let coarse = 1;  // ratio of the pixels of a frame
const state = {
  field: -1, turn: data.turn.slice(), zoom: 1, pan: [0, 0], compare: "", beside: false, split: 0.5, limits: [0, 1],
  log: false, creases: false, line: null, pin: null, fitted: true,
};
const COOL_WARM = [[59, 77, 191], [230, 230, 230], [191, 5, 38]];
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137],
  [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]];
// colours of the codes of grades, from 0 on
const CODES = [[188, 189, 34], [23, 190, 207], [127, 127, 127], [227, 119, 194], [140, 86, 75], [148, 103, 189],
  [214, 39, 40], [44, 160, 44], [255, 127, 14], [217, 217, 217]];
const GREY = [0.75, 0.75, 0.75], BACK = [0.69, 0.54, 0.42], NEW = [1, 0.6, 0.2];
const TABLE = 256;  // colours of a palette with steps
const blend = (nodes, t) => {
  const x = nodes.length === TABLE ? Math.round(t * (TABLE - 1)) : t * (nodes.length - 1), k = Math.min(Math.floor(x), nodes.length - 2);
  return nodes[k].map((low, i) => Math.round(low + (x - k) * (nodes[k + 1][i] - low)));
};
// Places on the scale: the value itself, or its logarithm both ways from zero, linear up to the median size.
const linear_below = () => state.log ? data.fields[state.field].median || 1 : 0;
const place = value => {
  const at = linear_below();
  return at ? Math.sign(value) * Math.log1p(Math.abs(value) / at) : value;
};
const value_at = it => { const at = linear_below(); return at ? Math.sign(it) * Math.expm1(Math.abs(it)) * at : it; };

// Send the values of a field, and its colours. Graphics drivers may not know NaN.
const UNKNOWN = 1e30;
const colors_of = field => field.colors || (field.signed ? COOL_WARM : VIRIDIS);
function upload(index) {
  const field = data.fields[index], scan = meshes.scan;
  scan.value = buffer(gl.ARRAY_BUFFER, shades[index].map(it => isNaN(it) ? UNKNOWN : it));
  scan.exact = buffer(gl.ARRAY_BUFFER, sources[index]);
  scan.error = errors[index] ? buffer(gl.ARRAY_BUFFER, errors[index]) : null;
  const entries = new Uint8Array(4 * 256), nodes = colors_of(field);
  for (let k = 0; k < 256; k++) {
    entries.set([...(field.names ? CODES[Math.min(k, CODES.length - 1)] : blend(nodes, k / 255)), 255], 4 * k);
  }
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, entries);
}
// Faces between one vertex in each cell of a grid: enough while the mesh turns.
const GRID = 90, FACES_AT_ONCE = 30000;
function sparse_faces(mesh) {
  const {points, indices} = mesh, first = new Map(), chosen = new Uint32Array(points.length / 3), faces = [];
  const cell = x => Math.floor(GRID * 0.5 * (x + 1));
  for (let k = 0; k < chosen.length; k++) {
    const at = (cell(points[3 * k]) * GRID + cell(points[3 * k + 1])) * GRID + cell(points[3 * k + 2]);
    if (!first.has(at)) first.set(at, k);
    chosen[k] = first.get(at);
  }
  const end = mesh.new_from ?? indices.length;
  for (let k = 0; k < end; k += 3) {
    const [a, b, c] = [chosen[indices[k]], chosen[indices[k + 1]], chosen[indices[k + 2]]];
    if (a !== b && b !== c && c !== a) faces.push(a, b, c);
  }
  const first_new = faces.length;
  for (let k = end; k < indices.length; k++) faces.push(indices[k]);
  return {...mesh, order: buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(faces)), count: faces.length,
    new_from: mesh.new_from === null ? null : first_new};
}
const sparse = {};
function drawn(mesh) {
  if (coarse === 1 || mesh.lines || mesh.count < 3 * FACES_AT_ONCE) return mesh;
  const name = Object.keys(meshes).find(it => meshes[it] === mesh), {position, normal, value, exact, error} = mesh;
  return {...(sparse[name] ??= sparse_faces(mesh)), position, normal, value, exact, error};
}
function submit(mesh, part) {
  ATTRIBUTES.forEach((name, at) => {
    if (!mesh[name]) { gl.disableVertexAttribArray(at); gl.vertexAttrib1f(at, NaN); return; }
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh[name]);
    gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, at < 2 ? 3 : 1, gl.FLOAT, false, 0, 0);
  });
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.order);
  const [first, count] = part || [0, mesh.count];
  if (mesh.count) gl.drawElements(mesh.lines ? gl.LINES : gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
  else gl.drawArrays(gl.POINTS, 0, mesh.points.length / 3);
}
function paint(mesh, options) {
  gl.uniform3fv(painter.uniform("plain"), options.plain || GREY);
  gl.uniform3fv(painter.uniform("back"), options.back || BACK);
  for (const name of ["mapped", "codes", "flat_", "lit"]) gl.uniform1i(painter.uniform(name), options[name] ? 1 : 0);
  submit(mesh, options.part);
}
// Scales of a picture of so many pixels, and the camera of a program.
const scales = (wide, tall) => [wide, tall].map(side => 0.95 * state.zoom * Math.min(wide, tall) / side);
function aim({made, uniform}, wide, tall, size) {
  gl.useProgram(made);
  gl.uniformMatrix3fv(uniform("turn"), true, state.turn);
  gl.uniform2fv(uniform("zoom"), scales(wide, tall)); gl.uniform2fv(uniform("pan"), state.pan);
  gl.uniform1f(uniform("nearer"), 0); gl.uniform1f(uniform("size"), size);
  gl.uniform1f(uniform("linear_below"), state.field < 0 ? 0 : linear_below());
}
// Parts of the picture, in shares of its width: [mesh, left, right of its pixels, left, right of its own picture].
function halves() {
  const other = meshes[state.compare];
  if (!other) return [[meshes.scan, 0, 1, 0, 1]];
  if (state.beside) return [[meshes.scan, 0, 0.5, 0, 0.5], [other, 0.5, 1, 0.5, 1]];
  return [[meshes.scan, 0, state.split, 0, 1], [other, state.split, 1, 0, 1]];
}
const parsed = text => text.trim().slice(1).match(/../g).map(it => parseInt(it, 16) / 255);
const ground = () => parsed(getComputedStyle(document.documentElement).getPropertyValue("--canvas"));

function render(wide, tall, ratio, background) {
  canvas.width = wide; canvas.height = tall;
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.disable(gl.SCISSOR_TEST); gl.clearColor(...background, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.SCISSOR_TEST);
  const field = data.fields[state.field], compared = !!meshes[state.compare];
  for (const [whole, from, to, left, right] of halves()) {
    const mesh = drawn(whole), [x, end] = [Math.round(from * wide), Math.round(to * wide)], own = Math.round((right - left) * wide);
    gl.viewport(Math.round(left * wide), 0, own, tall); gl.scissor(x, 0, end - x, tall);
    aim(painter, own, tall, 4 * ratio * Math.sqrt(state.zoom));
    if (compared) {
      const old = mesh.new_from ?? mesh.count;
      paint(mesh, {flat_: mesh.count > 0, lit: true, part: [0, old]});
      if (old < mesh.count) paint(mesh, {flat_: true, lit: true, plain: NEW, back: NEW, part: [old, mesh.count - old]});
    } else if (field) {
      gl.uniform2fv(painter.uniform("limits"), field.names ? [0, 1] : state.limits.map(place));
      paint(mesh, {mapped: true, codes: !!field.names, lit: mesh.count > 0 || !!mesh.normals});
    } else paint(mesh, {flat_: mesh.count > 0, lit: mesh.count > 0 || !!mesh.normals});
    const lines = state.creases && !compared ? data.lines.map(line => [meshes[line.mesh], line.color]) : [];
    if (state.line && trace.count) lines.push([trace, background[0] > 0.5 ? [0, 0, 0] : [1, 1, 1]]);
    lines.forEach(([line, plain], k) => {
      gl.uniform1f(painter.uniform("nearer"), 0.004 + 0.001 * k);  // lines lie on the surface; wide ones are several
      for (const [dx, dy] of line ? [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]] : []) {
        gl.uniform2f(painter.uniform("pan"), state.pan[0] + 2 * ratio * dx / own, state.pan[1] + 2 * ratio * dy / tall);
        paint(line, {plain});
      }
    });
    if (x > 0) {
      gl.scissor(x - Math.ceil(ratio), 0, 2 * Math.ceil(ratio), tall); gl.clearColor(...background.map(it => 1 - it), 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }
  }
  gl.disable(gl.SCISSOR_TEST);
}
// Frames that are late are drawn with fewer pixels and faces, until nothing moves.
let wanted = false, last_frame = -Infinity, settle = 0;
const LATE = 50, IDLE = 250, MAX_COARSE = 2;  // milliseconds, and the ratio of the pixels
function draw_moving(time) {
  const gap = time - last_frame;
  coarse = gap > IDLE ? 1 : gap > LATE ? Math.min(MAX_COARSE, 2 * coarse) : coarse;
  last_frame = time;
  clearTimeout(settle); settle = setTimeout(() => { if (coarse > 1) { coarse = 1; draw_now(); } }, IDLE);
  draw_now();
}
const draw_now = () => {
  const ratio = (window.devicePixelRatio || 1) / coarse;
  wanted = false;
  render(Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio), ratio, ground());
  put_pin();
  document.body.dataset.drawn = "yes";
};
function draw() { if (!wanted) { wanted = true; requestAnimationFrame(draw_moving); } }

// A picture of one pixel, in which the mesh is drawn that lies there.
const pixel = gl.createFramebuffer();
gl.bindFramebuffer(gl.FRAMEBUFFER, pixel);
[gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1, gl.DEPTH_ATTACHMENT].forEach((at, k) => {
  const made = gl.createRenderbuffer();
  gl.bindRenderbuffer(gl.RENDERBUFFER, made);
  gl.renderbufferStorage(gl.RENDERBUFFER, k < 2 ? gl.RGBA32UI : gl.DEPTH_COMPONENT24, 1, 1);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, made);
});
gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
gl.bindFramebuffer(gl.FRAMEBUFFER, null);

// What lies under a place of the picture, in pixels of the page: the point in units of the page, value and error.
function pick(x, y) {
  const wide = canvas.clientWidth, tall = canvas.clientHeight;
  const [mesh, , , left, right] = halves().find(([, from, to]) => x >= from * wide && x <= to * wide) || halves()[0];
  const own = (right - left) * wide, closer = 8 * Math.max(own, tall);  // an eighth of a pixel fills the picture
  gl.bindFramebuffer(gl.FRAMEBUFFER, pixel);
  gl.viewport(0, 0, 1, 1);
  [0, 1].forEach(k => gl.clearBufferuiv(gl.COLOR, k, [0, 0, 0, 0]));
  gl.clearBufferfv(gl.DEPTH, 0, [1]);
  aim(picker, own, tall, 12);
  const at = relative(x, y);
  gl.uniform2fv(picker.uniform("zoom"), scales(own, tall).map(size => size * closer));
  gl.uniform2fv(picker.uniform("pan"), at.map((it, k) => (state.pan[k] - it) * closer));
  submit(mesh);
  const bits = [0, 1].map(k => {
    const found = new Uint32Array(4);
    gl.readBuffer(gl.COLOR_ATTACHMENT0 + k); gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found);
    return found;
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  if (!bits[0][3]) return null;
  const numbers = bits.map(it => new Float32Array(it.buffer));
  return {point: [...numbers[0].subarray(0, 3)], value: numbers[1][0], error: numbers[1][1], before: mesh === meshes.scan};
}
function nearest_vertex([x, y, z]) {
  const points = meshes.scan.points;
  let best = 0, least = Infinity;
  for (let k = 0; k < points.length; k += 3) {
    const distance = (points[k] - x) ** 2 + (points[k + 1] - y) ** 2 + (points[k + 2] - z) ** 2;
    if (distance < least) { least = distance; best = k / 3; }
  }
  return best;
}
// Width and beginning of the part of the picture with a place, in pixels of the page.
function pane(x = 0) {
  const wide = canvas.clientWidth, half = meshes[state.compare] && state.beside;
  return half ? [wide / 2, x > wide / 2 ? wide / 2 : 0] : [wide, 0];
}
// A place of the picture, in pixels of the page, as one from -1 to 1 both ways.
function relative(x, y) {
  const [wide, left] = pane(x);
  return [2 * (x - left) / wide - 1, 1 - 2 * y / canvas.clientHeight];
}
// A place of the picture, in pixels of the page, as one of the turned mesh.
function placed(x, y) {
  const size = scales(pane(x)[0], canvas.clientHeight);
  return relative(x, y).map((at, k) => (at - state.pan[k]) / size[k]);
}
// Where a point is seen, in pixels of the page.
function projected(point) {
  const wide = canvas.clientWidth, tall = canvas.clientHeight, [across, up] = scales(wide, tall), m = state.turn;
  const [x, y] = [0, 1].map(i => m[3 * i] * point[0] + m[3 * i + 1] * point[1] + m[3 * i + 2] * point[2]);
  return [(x * across + state.pan[0] + 1) * wide / 2, (1 - y * up - state.pan[1]) * tall / 2];
}
function turned(x, y) {
  const [c, s, d, t] = [Math.cos(x), Math.sin(x), Math.cos(y), Math.sin(y)], m = state.turn;
  const about = [c, 0, s, s * t, d, -c * t, -s * d, t, c * d], result = [];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) result.push([0, 1, 2].reduce((sum, k) => sum + about[3 * i + k] * m[3 * k + j], 0));
  }
  state.turn = result;
}
// Turn a direction to the viewer, and leave upright what is.
function faced(direction) {
  const unit = it => { const length = Math.hypot(...it); return it.map(x => x / length); };
  const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
  if (!(Math.hypot(...direction) > 0)) return;
  const near = unit(direction), up = [3, 4, 5].map(k => state.turn[k]);
  let right = cross(up, near);
  if (Math.hypot(...right) < 1e-3) right = [0, 1, 2].map(k => state.turn[k]);
  right = unit(right);
  state.turn = [...right, ...cross(near, right), ...near];
}
function moved(x, y) {
  state.fitted = false;
  state.pan[0] += 2 * x / pane()[0]; state.pan[1] -= 2 * y / canvas.clientHeight;
}
// Choose zoom and place so that the mesh fills a picture of so many pixels.
function fit(wide = pane()[0], tall = canvas.clientHeight) {
  const points = meshes.scan.points, m = state.turn, low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  for (let k = 0; k < points.length; k += 3) {
    for (let i = 0; i < 2; i++) {
      const at = m[3 * i] * points[k] + m[3 * i + 1] * points[k + 1] + m[3 * i + 2] * points[k + 2];
      if (at < low[i]) low[i] = at;
      if (at > high[i]) high[i] = at;
    }
  }
  const half = low.map((it, i) => Math.max(0.5 * (high[i] - it), 1e-6));
  state.zoom = Math.min(wide / half[0], tall / half[1]) / Math.min(wide, tall);
  state.pan = scales(wide, tall).map((size, i) => -0.5 * (low[i] + high[i]) * size);
  state.fitted = true;
}
// Zoom about a place of the picture, which stays where it is.
function zoomed(factor, x, y) {
  state.fitted = false;
  const zoom = Math.min(200, Math.max(0.2, state.zoom * factor)), by = zoom / state.zoom;
  const at = relative(x, y);
  state.pan = state.pan.map((pan, k) => at[k] - by * (at[k] - pan));
  state.zoom = zoom;
}
