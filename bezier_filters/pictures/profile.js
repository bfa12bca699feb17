// The profile of a mesh along a line on the screen: what the plane through the line and the direction of sight cuts of
// it, where that is seen. Points are in units of the page, `turn` is the rotation by which they are seen, the line goes
// from one place [x, y] of the turned mesh to another. Result: distances from the beginning of the line, heights
// towards the viewer, and values of fields on the vertices; NaN where there is no surface.
function profile(mesh, turn, from, to, fields, pieces = 400) {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]), [c, s] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
  const count = mesh.points.length / 3, [along, across, height] = [0, 1, 2].map(() => new Float64Array(count));
  for (let k = 0; k < count; k++) {
    const [x, y, z] = [0, 1, 2].map(i => turn[3 * i] * mesh.points[3 * k] + turn[3 * i + 1] * mesh.points[3 * k + 1] + turn[3 * i + 2] * mesh.points[3 * k + 2]);
    along[k] = c * (x - from[0]) + s * (y - from[1]); across[k] = c * (y - from[1]) - s * (x - from[0]); height[k] = z;
  }
  const empty = () => new Float64Array(pieces + 1).fill(NaN), heights = empty(), values = fields.map(empty);
  for (let k = 0; k < mesh.indices.length; k += 3) {
    const corners = mesh.indices.subarray(k, k + 3), above = (across[corners[0]] < 0) + (across[corners[1]] < 0) + (across[corners[2]] < 0);
    if (above === 0 || above === 3) continue;
    const ends = [];  // of the cut through the face: two corners, and the share of the second
    for (let i = 0; i < 3; i++) {
      const [a, b] = [corners[i], corners[(i + 1) % 3]];
      if ((across[a] < 0) !== (across[b] < 0)) ends.push([a, b, across[a] / (across[a] - across[b])]);
    }
    const at = (array, [a, b, share]) => array[a] + share * (array[b] - array[a]);
    ends.sort((p, q) => at(along, p) - at(along, q));
    const [begin, end] = ends.map(it => at(along, it) * pieces / length);
    const rounding = 1e-6;  // would leave gaps between faces
    for (let i = Math.max(0, Math.ceil(begin - rounding)); i <= Math.min(pieces, end + rounding); i++) {
      const share = end > begin ? (i - begin) / (end - begin) : 0, between = array => (1 - share) * at(array, ends[0]) + share * at(array, ends[1]);
      const found = between(height);
      if (heights[i] > found) continue;  // behind what is seen
      heights[i] = found;
      fields.forEach((field, j) => { values[j][i] = between(field); });
    }
  }
  return {distances: heights.map((_, i) => i * length / pieces), heights, values};
}

// Curves over distances on a canvas, each {values, color, errors?}; NaN are gaps. Errors make a band around theirs.
function chart(canvas, title, distances, curves, write, ink) {
  const ratio = window.devicePixelRatio || 1, wide = canvas.width = canvas.clientWidth * ratio, tall = canvas.height = canvas.clientHeight * ratio;
  const pen = canvas.getContext("2d"), left = 64 * ratio, top = 28 * ratio, right = wide - 12 * ratio, bottom = tall - 20 * ratio;
  const all = curves.flatMap(curve => [-1, 1].map(sign => curve.values.map((value, i) => value + sign * (curve.errors ? curve.errors[i] : 0)))).flatMap(values => [...values]).filter(Number.isFinite);
  let low = Math.min(...all), high = Math.max(...all);
  pen.fillStyle = ink; pen.font = `${12 * ratio}px system-ui, sans-serif`; pen.fillText(title, 6 * ratio, 14 * ratio);
  if (!all.length) return;
  const least = 1e-5 * Math.max(Math.abs(low), Math.abs(high)) || 1e-12;  // what differs by less, single precision has made
  if (high - low < least) { low -= least; high += least; }
  const x = distance => left + (right - left) * distance / distances[distances.length - 1], y = value => bottom - (bottom - top) * (value - low) / (high - low);
  pen.textAlign = "right"; pen.textBaseline = "middle"; pen.strokeStyle = "#8888"; pen.lineWidth = ratio;
  for (const value of [low, 0.5 * (low + high), high]) { pen.fillText(write(value), left - 6 * ratio, y(value)); pen.beginPath(); pen.moveTo(left, y(value)); pen.lineTo(right, y(value)); pen.stroke(); }
  pen.textBaseline = "bottom";
  for (const share of [0, 0.5, 1]) { pen.textAlign = ["left", "center", "right"][2 * share]; pen.fillText(write(share * distances[distances.length - 1]), left + share * (right - left), tall - 2 * ratio); }
  for (const {values, color, errors} of curves) {
    pen.fillStyle = pen.strokeStyle = color;
    pen.globalAlpha = 0.25;
    if (errors) values.forEach((value, i) => { if (Number.isFinite(value)) pen.fillRect(x(distances[i]), y(value + errors[i]), (right - left) / values.length + 1, Math.max(y(value - errors[i]) - y(value + errors[i]), 0)); });
    pen.globalAlpha = 1; pen.lineWidth = 1.5 * ratio; pen.beginPath();
    values.forEach((value, i) => { if (Number.isFinite(value)) Number.isFinite(values[i - 1]) ? pen.lineTo(x(distances[i]), y(value)) : pen.moveTo(x(distances[i]), y(value)); });
    pen.stroke();
  }
}
