// The text of the page, its legend and tables, and what users do.
const MINUS = "\u2212", narrow = window.matchMedia("(max-width: 800px)");
const written = text => text.replace("-", MINUS);
const number = value => Number.isFinite(value) ? written(Number(value.toPrecision(3)).toString()) : "unknown";
// A value with its standard error: digits to the second one of the error.
function with_error(value, error) {
  if (!Number.isFinite(value)) return "unknown";
  if (!(error > 0)) return written(Number(value.toPrecision(6)).toString());
  const digits = Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(error))));
  return `${written(value.toFixed(digits))} \u00b1 ${error.toFixed(digits)}`;
}
const element = (tag, text, parent, more) => parent.appendChild(Object.assign(document.createElement(tag), {textContent: text, ...more}));

document.querySelector("h1").textContent = data.title;
document.querySelector("h1").hidden = !data.title;
$("about").textContent = data.about.join(" \u00b7 ");
$("verdict").hidden = !data.verdict.length;
document.querySelector("header").hidden = !data.title && !data.verdict.length;
function list_verdict(list) {
  data.verdict.forEach(([text, command]) => {
    const item = element("li", text, list);
    if (command) element("code", command, item);
  });
}
list_verdict($("verdict"));
function table(parent, {title, header, rows, places}, most = Infinity) {
  const made = element("table", "", parent), head = element("tr", "", element("thead", "", made)), body = element("tbody", "", made), shows = places && most === Infinity;
  if (shows) element("th", "place", head, {scope: "col"});
  header.forEach((text, k) => element("th", text, head, {scope: "col", className: k && rows.every(row => typeof row[k] === "number" || row[k] === "") ? "number" : ""}));
  rows.slice(0, most).forEach((row, n) => {
    const line = element("tr", "", body);
    if (shows) element("button", "Show", element("td", "", line), {type: "button", onclick: () => visit(places[n])});
    row.forEach((cell, k) => typeof cell === "number"
      ? element("td", Number.isInteger(cell) ? cell.toLocaleString("en") : written(Number(cell.toPrecision(4)).toString()), line, {className: "number"})
      : element(k ? "td" : "th", cell, line, k ? {} : {scope: "row"}));
  });
  if (rows.length > most) element("p", `and ${rows.length - most} more`, parent, {className: "hint"});
  return made;
}
data.tables.forEach(it => {
  const section = element("section", "", $("tables"));
  element("h2", it.title, section); table(section, it);
});
if (data.findings.length) {
  const section = element("section", "", $("tables")), list = (element("h2", "Findings", section), element("ul", "", section));
  data.findings.forEach(text => element("li", text, list));
}

// fields and comparisons to choose
function radio(parent, group, value, label, change, hint) {
  const line = element("label", "", parent, {className: hint === undefined ? "" : "field"});
  const input = element("input", "", line, {type: "radio", name: group, value, onchange: change}), text = element("span", "", line);
  if (hint === undefined) text.textContent = label;
  else { element("b", label, text); element("span", hint, text, {className: "hint"}); }
  return input;
}
data.groups.forEach(([name, members]) => {
  const set = element("fieldset", "", $("fields"));
  element("legend", name, set);
  members.forEach(k => {
    const field = data.fields[k];
    radio(set, "field", k, field.label, () => {
      compare(""); choose(k);
      if (narrow.matches) $("picture").scrollIntoView();
    }, field.purpose);
  });
});
$("fields").hidden = !data.fields.length;
data.comparisons.forEach(([name, text]) => radio($("modes"), "mode", name, text[0].toUpperCase() + text.slice(1), () => compare(name)));
if (data.fields.length) radio($("modes"), "mode", "", "Fields", () => { compare(""); choose(Math.max(state.field, 0)); });
else radio($("modes"), "mode", "", "Shape", () => compare(""));
[["", "Slider"], ["beside", "Side by side"]].forEach(([value, label]) => radio($("layouts"), "layout", value, label, () => { state.beside = !!value; compare(state.compare); }));
const check = (group, value) => document.querySelectorAll(`input[name=${group}]`).forEach(it => { it.checked = it.value === String(value); });

function choose(index) {
  const field = data.fields[index];
  state.field = index;
  if (field) {
    if (!field.names) state.limits = (state.log ? field.range : field.limits).slice();
    upload(index);
  }
  show();
}
function key(list, entries) {
  list.replaceChildren();
  entries.forEach(([text, color]) => { const line = element("li", "", list); element("span", "", line).style.background = color; line.append(text); });
}
const css = color => `rgb(${color.map(it => Math.round(255 * it))})`;
function legend_of(field) {
  if (!field || !field.names) return field && field.unknown ? [[field.unknown, css(GREY)]] : [];
  return Object.entries(field.names).filter(([, name]) => name.count).reverse()
    .map(([code, name]) => [`${name.text}: ${name.count.toLocaleString("en")}`, `rgb(${CODES[code]})`]);
}
function comparison_key() {
  const other = meshes[state.compare], entries = [["outside", css(GREY)]];
  if (data.open) entries.push(["inside: backs of faces", css(BACK)]);
  if (other.new_from !== null && other.new_from < other.count) entries.push(["new faces", css(NEW)]);
  return entries;
}
function show() {
  const compared = !!state.compare, field = compared ? null : data.fields[state.field];
  check("field", compared ? "none" : state.field); check("mode", state.compare); check("layout", state.beside ? "beside" : "");
  $("bar").hidden = $("logging").hidden = !field || !!field.names;
  $("split").hidden = !compared || state.beside;
  $("layouts").hidden = $("before").hidden = $("after").hidden = !compared;
  const creases = state.creases ? data.lines.map(line => [line.name, css(line.color)]) : [];
  key($("names"), compared ? comparison_key() : [...legend_of(field), ...creases]);
  $("note").textContent = [compared ? data.comparisons.find(([other]) => other === state.compare)[2] : field ? field.remark : "", ...data.notes].filter(Boolean).join(" ");
  const what = compared ? `the mesh before and after ${data.comparisons.find(([other]) => other === state.compare)[1]}` : field ? field.label : "the mesh";
  canvas.setAttribute("aria-label", `${data.title || "Mesh"}: ${what}. Use arrow keys to turn.`);
  state.pin = null; $("tip").hidden = true;
  if (state.fitted) fit();
  if (field && !field.names) {
    $("unit").textContent = `${field.label}${field.unit ? ` [${field.unit}]` : ""}`;
    $("low").value = Number(state.limits[0].toPrecision(6)); $("high").value = Number(state.limits[1].toPrecision(6));
    legend($("scale"));
    $("scale").setAttribute("aria-label", `Legend: colours from ${number(state.limits[0])} to ${number(state.limits[1])} ${field.unit}, with a histogram of the values`);
  }
  cut(); draw();
}
// Round numbers on the scale, none too close to another: zero, then powers of ten, fives and twos, or even steps.
function round_ticks() {
  const [low, high] = state.limits, [from, to] = state.limits.map(place), chosen = [];
  if (!state.log) {
    const steps = data.fields[state.field].colors ? 6 : 4, all = Array.from({length: steps + 1}, (_, k) => low + k * (high - low) / steps);
    return all.map(it => Math.abs(it) < 1e-9 * (high - low) ? 0 : it);
  }
  const largest = Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high)))), sizes = [];
  for (const digit of [1, 5, 2]) for (let k = 0; k < 12; k++) sizes.push(Number(`${digit}e${largest - k}`));
  for (const value of [0, ...sizes.flatMap(size => [size, -size])]) {
    if (value >= low && value <= high && chosen.every(it => Math.abs(place(it) - place(value)) > 0.11 * (to - from))) chosen.push(value);
  }
  return chosen;
}
// The colours with a histogram above them and numbers below.
function legend(box, size, ink) {
  const field = data.fields[state.field], ratio = size ? 2 : window.devicePixelRatio || 1;
  box.width = (size ? size[0] : box.clientWidth) * ratio; box.height = (size ? size[1] : box.clientHeight) * ratio;
  const style = getComputedStyle(document.documentElement), color = ink || style.getPropertyValue("--ink");
  const pen = box.getContext("2d"), edge = 26 * ratio, wide = box.width - 2 * edge, tall = box.height, bins = 80, counts = new Array(bins).fill(0);
  const [low, high] = state.limits.map(place), nodes = colors_of(field);
  for (const found of shades[state.field]) { const k = Math.floor(bins * (place(found) - low) / (high - low)); if (k >= 0 && k < bins) counts[k]++; }
  const most = Math.max(1, ...counts);
  pen.clearRect(0, 0, box.width, tall);
  counts.forEach((count, k) => {
    pen.fillStyle = `rgb(${blend(nodes, (k + 0.5) / bins)})`;
    pen.fillRect(edge + k * wide / bins, 0.5 * tall, wide / bins + 1, 0.18 * tall);
    const height = 0.46 * tall * count / most;
    pen.fillRect(edge + k * wide / bins, 0.48 * tall - height, wide / bins + 1, height);
  });
  pen.strokeStyle = color; pen.globalAlpha = 0.4; pen.lineWidth = ratio; pen.strokeRect(edge, 0.5 * tall, wide, 0.18 * tall); pen.globalAlpha = 1;
  pen.fillStyle = color; pen.font = `${12 * ratio}px system-ui, sans-serif`; pen.textBaseline = "top"; pen.textAlign = "center";
  round_ticks().forEach(tick => {
    const x = edge + wide * (place(tick) - low) / (high - low);
    pen.fillRect(x - ratio / 2, 0.68 * tall, ratio, 4 * ratio); pen.fillText(number(tick), x, 0.68 * tall + 7 * ratio);
  });
}

// values under the pointer
const PLACE_DIGITS = 6;
function reading(found) {
  if (!found) return "";
  const field = state.compare ? null : data.fields[state.field], vertex = nearest_vertex(found.point);
  const at = found.point.map((x, k) => written(Number((data.center[k] + data.radius * x).toPrecision(PLACE_DIGITS)).toString())).join(", ");
  let what = state.compare ? (found.before ? "before" : "after") : "";
  if (field && field.names) what = field.names[Math.round(sources[state.field][vertex])].text;
  else if (field) what = `${field.label} ${with_error(found.value, found.error)}${field.unit ? ` ${field.unit}` : ""}`;
  const near = data.whole ? `, near vertex ${vertex.toLocaleString("en")}` : "";
  return `${what}${what ? " " : ""}at (${at})${near}`;
}
function put_pin() {
  $("pin").hidden = !state.pin;
  if (state.pin && !state.beside) { const [x, y] = projected(state.pin); $("pin").style.transform = `translate(${x}px, ${y}px)`; } else $("pin").hidden = true;
}
// Turn a place, in coordinates of the file, to the viewer, near and with a pin.
const CLOSER = 4;
function visit(place) {
  const point = place.map((x, k) => (x - data.center[k]) / data.radius), {scan} = meshes, at = 3 * nearest_vertex(point);
  if (state.beside) { state.beside = false; compare(state.compare); }
  reset(); faced(scan.arrows.slice(at, at + 3)); fit();
  state.zoom *= CLOSER; state.fitted = false; state.pan = [0, 0];
  const [x, y] = projected(point);
  state.pan = relative(x, y).map(it => -it);
  state.pin = point;
  $("picture").scrollIntoView({block: "nearest"}); put_pin(); draw();
}
function read_at(x, y) {
  const found = pick(x, y);
  state.pin = found && found.point;
  $("reading").textContent = reading(found) || "There is no surface at this place.";
  put_pin();
}
let hovered = null;
function hover() {
  if (!hovered) return;
  const [x, y] = hovered, text = reading(pick(x, y)), tip = $("tip");
  hovered = null; tip.hidden = !text; tip.textContent = text;
  const left = Math.max(0, Math.min(x + 14, canvas.clientWidth - tip.offsetWidth));
  tip.style.transform = `translate(${left}px, ${y > 50 ? y - 34 : y + 20}px)`;
}

// the profile along a line that is drawn on the mesh, which keeps its place when the mesh turns
const trace = {lines: true, count: 0, position: gl.createBuffer(), order: gl.createBuffer()};
let curves = null;
function cut() {
  const line = state.line, other = meshes[state.compare], field = other ? null : data.fields[state.field];
  $("profile").hidden = !$("cut").checked; $("curve").hidden = $("heights").hidden = !line;
  if (!line) return;
  const valued = field && !field.names, known = valued && errors[state.field];
  const columns = valued ? [sources[state.field], ...(known ? [known] : [])] : [];
  const scan = profile(meshes.scan, line.turn, line.from, line.to, columns), all = [scan];
  if (other) all.push(profile(other, line.turn, line.from, line.to, []));
  const lowest = all.reduce((least, it) => it.heights.reduce((low, x) => x < low ? x : low, least), Infinity);
  const heights = all.map(it => it.heights.map(height => (height - lowest) * data.radius)), distances = scan.distances.map(it => it * data.radius);
  curves = {distances, heights, field, values: scan.values};
  $("curve").hidden = !valued;
  $("heights").style.width = valued ? "" : "100%";
  $("read").textContent = "Point at a curve to read it.";
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--ink");
  const titles = [valued ? `${field.label}${field.unit ? ` [${field.unit}]` : ""}${known ? " and its standard error" : ""}` : "", `height over distance [length]${other ? ": before grey, after orange" : ""}`];
  if (valued) chart($("curve"), titles[0], distances, [{values: scan.values[0], errors: scan.values[1], color: "#3b6fd0"}], number, ink);
  chart($("heights"), titles[1], distances, heights.map((values, k) => ({values, color: k ? "#e67e00" : "#808080"})), number, ink);
  ["curve", "heights"].forEach((id, k) => $(id).setAttribute("aria-label", `Profile: ${titles[k]}`));
  traced(scan, line);
}
function traced({distances, heights}, {turn: m, from, to}) {
  const length = distances[distances.length - 1], points = [], order = [];
  distances.forEach((distance, i) => {
    const share = distance / length, seen = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1]), heights[i]];
    for (let k = 0; k < 3; k++) points.push(m[k] * seen[0] + m[3 + k] * seen[1] + m[6 + k] * seen[2]);
    if (Number.isFinite(heights[i]) && Number.isFinite(heights[i - 1])) order.push(i - 1, i);
  });
  gl.bindBuffer(gl.ARRAY_BUFFER, trace.position); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.STREAM_DRAW);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, trace.order); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(order), gl.STREAM_DRAW);
  trace.count = order.length;
}
function lined(from, to) { state.line = Math.hypot(to[0] - from[0], to[1] - from[1]) > 1e-4 ? {turn: state.turn.slice(), from, to} : null; cut(); draw(); }
function read(event) {
  const box = event.target, i = Math.round((curves.distances.length - 1) * Math.min(1, Math.max(0, (event.offsetX - 64) / (box.clientWidth - 76))));
  const readings = curves.field && curves.values.length ? [`${curves.field.label} ${curves.values.map(values => number(values[i])).join(" \u00b1 ")} ${curves.field.unit}`] : [];
  $("read").textContent = `At ${number(curves.distances[i])}: ` + [...readings, `height ${curves.heights.map(values => number(values[i])).join(" before, ")}${curves.heights[1] ? " after" : ""}`].join("; ");
}
["curve", "heights"].forEach(id => { $(id).onpointermove = read; });

// pictures and tables to save, and to print
function save(name, content, type) {
  const link = Object.assign(document.createElement("a"), {download: name});
  link.href = URL.createObjectURL(new Blob([content], {type}));
  link.click(); setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
const stem = (data.title || "mesh").replace(/\.[^.]*$/, "").replace(/[^\w.-]+/g, "_");
// The picture with its title and legend, on paper of any colour.
function sheet(target, wide, tall, ratio = 2, size_to_paper = true) {
  const kept = [canvas.width, canvas.height], field = state.compare ? null : data.fields[state.field];
  const entries = state.compare ? comparison_key() : legend_of(field), bar_height = field && !field.names ? 76 : 10;
  const below = bar_height + 4 + 18 * entries.length, top = 26, pen = target.getContext("2d");
  target.width = wide * ratio; target.height = (tall + top + below) * ratio;
  pen.scale(ratio, ratio); pen.fillStyle = "#fff"; pen.fillRect(0, 0, wide, tall + top + below);
  const camera = {zoom: state.zoom, pan: state.pan, fitted: state.fitted};
  if (size_to_paper) fit(state.compare && state.beside ? wide / 2 : wide, tall);
  render(wide * ratio, tall * ratio, ratio, [1, 1, 1]);
  Object.assign(state, camera);
  pen.drawImage(canvas, 0, top, wide, tall);
  [canvas.width, canvas.height] = kept;
  const text = state.compare ? `Before and after ${data.comparisons.find(([it]) => it === state.compare)[1]}` : field ? `${field.label}${field.unit ? ` [${field.unit}]` : ""}` : "Shape";
  pen.fillStyle = "#000"; pen.font = `600 ${wide < 500 ? 11.5 : 13}px system-ui, sans-serif`; pen.fillText(text, 4, 15);
  pen.font = "12px system-ui, sans-serif";
  if (field && !field.names) {
    const bar = document.createElement("canvas");
    legend(bar, [wide, 72], "#000"); pen.drawImage(bar, 0, tall + top + 4, wide, 72);
  }
  entries.forEach(([name, color], k) => {
    const y = tall + top + bar_height - 2 + 18 * k;
    pen.fillStyle = color; pen.fillRect(4, y, 14, 11); pen.strokeRect(4, y, 14, 11); pen.fillStyle = "#000"; pen.fillText(name, 26, y + 10);
  });
}
function save_picture() {
  const target = document.createElement("canvas");
  sheet(target, canvas.clientWidth, canvas.clientHeight, Math.max(2, window.devicePixelRatio || 1), false); draw();
  target.toBlob(blob => save(`${stem}.png`, blob, "image/png"));
}
function tables_as_csv() {
  const quoted = cell => /[",\n]/.test(cell) ? `"${String(cell).replace(/"/g, '""')}"` : String(cell);
  const rows = data.tables.flatMap(it => [[it.title], it.header, ...it.rows, []]);
  return rows.map(row => row.map(quoted).join(",")).join("\r\n");
}
function prepare_paper() {
  const paper = $("paper"), kept = {...state, limits: state.limits.slice()};
  paper.replaceChildren();
  const [first, second] = [0, 1].map(() => element("div", "", paper, {className: "sheet"}));
  element("h1", data.title || "Mesh", first); element("p", data.about.join(" \u00b7 "), first);
  list_verdict(element("ol", "", first));
  const put = (parent, change, wide, tall) => { Object.assign(state, {creases: false, line: null, log: false, ...change}); if (!state.compare) { state.limits = (data.fields[state.field] || {limits: [0, 1]}).limits || [0, 1]; if (state.field >= 0) upload(state.field); } sheet(element("canvas", "", parent), wide, tall); };
  if (kept.compare || data.comparisons.length) put(first, {compare: kept.compare || data.comparisons[0][0], beside: true}, 720, 280);
  else put(first, {compare: ""}, 720, 280);
  const on_second = it => it.title === "Fields";
  data.tables.filter(it => !on_second(it)).forEach(it => { element("h2", it.title, first); table(first, it, it === data.tables[0] ? 12 : 6); });
  if (data.findings.length) {
    const list = (element("h2", "Findings", first), element("ul", "", first));
    data.findings.forEach(text => element("li", text, list));
  }
  const pictures = element("div", "", second, {className: "pictures"}), shown = data.fields.map((_, k) => k).filter(k => data.fields[k].printed).slice(0, 4);
  shown.forEach(k => put(pictures, {compare: "", field: k}, 340, 165));
  data.tables.filter(on_second).forEach(it => { element("h2", it.title, second); table(second, it); });
  Object.assign(state, kept);
  if (state.field >= 0) upload(state.field);
  draw_now();
}
window.onbeforeprint = prepare_paper;

// what users do
const compare = name => {
  state.compare = name;
  if (!name && state.field < 0 && data.fields.length) { choose(0); return; }
  show();
};
$("logging").hidden = true; $("modes").hidden = !data.comparisons.length; $("cutting").hidden = !meshes.scan.count;
$("lines").hidden = !data.lines.length; $("lines").querySelector("span").textContent = data.lines_label; $("csv").hidden = !data.tables.length;
$("split").oninput = event => { state.split = Number(event.target.value); draw(); };
$("log").onchange = event => { state.log = event.target.checked; choose(state.field); };
$("creases").onchange = event => { state.creases = event.target.checked; if (state.compare) compare(""); else show(); };
["low", "high"].forEach((id, k) => { $(id).onchange = event => {
  const limits = state.limits.slice(); limits[k] = Number(event.target.value);
  if (limits[0] < limits[1]) state.limits = limits;
  show();
}; });
$("cut").onchange = event => { canvas.style.cursor = event.target.checked ? "crosshair" : ""; state.line = null; cut(); draw(); };
const reset = () => { Object.assign(state, {turn: data.turn.slice(), line: null, pin: null}); fit(); cut(); draw(); };
$("reset").onclick = canvas.ondblclick = reset;
$("png").onclick = save_picture;
$("csv").onclick = () => save(`${stem}.csv`, tables_as_csv(), "text/csv");
$("printing").onclick = () => window.print();

const touches = new Map();  // pointers that are down: where each is, and where it began
const middle_of = points => [0, 1].map(k => points.reduce((sum, it) => sum + it[k], 0) / points.length);
const spread_of = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
canvas.onpointerdown = event => {
  canvas.setPointerCapture(event.pointerId);
  const at = [event.offsetX, event.offsetY];
  touches.set(event.pointerId, {at, begin: at, still: touches.size === 0});
  if (touches.size > 1) touches.forEach(it => { it.still = false; });
  $("tip").hidden = true;
};
canvas.onpointermove = event => {
  const at = [event.offsetX, event.offsetY], touch = touches.get(event.pointerId);
  if (!touch) {
    if (event.pointerType !== "touch" && !event.buttons) { if (!hovered) requestAnimationFrame(hover); hovered = at; }
    return;
  }
  const before = [...touches.values()].map(it => it.at), by = [at[0] - touch.at[0], at[1] - touch.at[1]];
  touch.at = at;
  if (Math.hypot(at[0] - touch.begin[0], at[1] - touch.begin[1]) > 5) touch.still = false;
  if (touches.size > 1) {
    const after = [...touches.values()].map(it => it.at), [was, is] = [middle_of(before), middle_of(after)];
    moved(is[0] - was[0], is[1] - was[1]); zoomed(spread_of(after) / spread_of(before), ...is);
  } else if ($("cut").checked && !event.shiftKey) { lined(placed(...touch.begin), placed(...at)); return; }
  else if (event.shiftKey || event.buttons === 4) moved(...by);
  else { const size = Math.min(canvas.clientWidth, canvas.clientHeight); turned(4 * by[0] / size, 4 * by[1] / size); }
  draw();
};
canvas.onpointerup = canvas.onpointercancel = event => {
  const touch = touches.get(event.pointerId);
  touches.delete(event.pointerId);
  if (touch && touch.still && event.type === "pointerup" && !$("cut").checked) read_at(...touch.at);
};
canvas.onpointerleave = () => { hovered = null; $("tip").hidden = true; };
canvas.addEventListener("wheel", event => { event.preventDefault(); zoomed(Math.exp(-0.001 * event.deltaY), event.offsetX, event.offsetY); draw(); }, {passive: false});
canvas.onkeydown = event => {
  const arrow = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key], middle = [canvas.clientWidth / 2, canvas.clientHeight / 2];
  const STEP = Math.PI / 24, PIXELS = 30;
  if (arrow && event.shiftKey) moved(PIXELS * arrow[0], PIXELS * arrow[1]);
  else if (arrow) turned(STEP * arrow[0], STEP * arrow[1]);
  else if (event.key === "+" || event.key === "=") zoomed(1.2, ...middle);
  else if (event.key === "-") zoomed(1 / 1.2, ...middle);
  else if (event.key === "0") reset();
  else if (event.key === "Enter") read_at(...middle);
  else return;
  event.preventDefault(); draw();
};
window.onresize = show;
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
// A link may say what is shown: #field=0&turn=40&tilt=-10&compare=smoothed&creases&profile=0.2,0.5,0.8,0.5
const asked = new URLSearchParams(location.hash.slice(1));
fit();
turned(Number(asked.get("turn") || 0) * Math.PI / 180, Number(asked.get("tilt") || 0) * Math.PI / 180);
if (asked.has("log")) { state.log = $("log").checked = true; }
if (asked.has("creases") || data.lines_first) { state.creases = $("creases").checked = true; }
if (asked.has("split")) { state.split = Number(asked.get("split")); $("split").value = state.split; }
state.beside = asked.has("beside");
const first_shown = asked.get("compare") ?? (asked.has("field") || asked.has("creases") ? "" : data.start);
if (asked.has("field") || !first_shown) choose(Number(asked.get("field") ?? (data.fields.length ? 0 : -1)));
compare(first_shown);
if (asked.has("profile")) {
  const [a, b, c, d] = asked.get("profile").split(",").map(Number);
  $("cut").checked = true; cut();
  const [wide, tall] = [canvas.clientWidth, canvas.clientHeight];
  lined(placed(a * wide, b * tall), placed(c * wide, d * tall));
}
