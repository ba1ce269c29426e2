// What the server sends: the answers, read (wire.h says what the bytes mean).
'use strict';

const View = {};

View.get = async (path) => {
  const answer = await fetch(path, {cache: 'no-store'});
  if (!answer.ok) throw new Error(`${path.split('?')[0]}: ${answer.status} ${(await answer.text()).trim()}`);
  return answer;
};
View.json = async (path) => (await View.get(path)).json();
View.bytes = async (path) => (await View.get(path)).arrayBuffer();

// {frame, blocks: [{key, positions, shapes, indices}]}
View.readBlocks = (buffer, start = 0) => {
  const head = new DataView(buffer);
  const int = (at) => head.getInt32(at, true);
  const result = {frame: int(start), blocks: []};
  let at = start + 8;
  for (let n = int(start + 4); n > 0; --n) {
    const key = `${int(at)},${int(at + 4)},${int(at + 8)}`;
    const vertices = int(at + 12), triangles = int(at + 16);
    at += 20;
    const block = {key, positions: new Float32Array(buffer, at, 3 * vertices)};
    at += 12 * vertices;
    block.shapes = new Int16Array(buffer, at, 4 * vertices);
    at += 8 * vertices;
    block.indices = new Uint32Array(buffer, at, 3 * triangles);
    at += 12 * triangles;
    result.blocks.push(block);
  }
  return result;
};

// What packed_mesh() packed (report_scene.h), as readBlocks() gives it, with normals made of the triangles.
View.unpackMesh = (buffer) => {
  const head = new DataView(buffer), bytes = new Uint8Array(buffer);
  const origin = [0, 4, 8].map((at) => head.getFloat32(at, true)), step = head.getFloat32(12, true);
  const vertices = head.getUint32(16, true), triangles = head.getUint32(20, true);
  let at = 24;
  const difference = () => {
    let value = 0, scale = 1;
    for (;;) {
      const byte = bytes[at++];
      value += (byte & 127) * scale;
      if (byte < 128) return value % 2 ? -(value + 1) / 2 : value / 2;
      scale *= 128;
    }
  };
  const positions = new Float32Array(3 * vertices), indices = new Uint32Array(3 * triangles);
  for (let axis = 0; axis < 3; ++axis)
    for (let v = 0, place = 0; v < vertices; ++v) positions[3 * v + axis] = origin[axis] + step * (place += difference());
  for (let i = 0, corner = 0; i < indices.length; ++i) indices[i] = corner += difference();
  const normals = new Float32Array(3 * vertices);
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => 3 * indices[i + k]), p = positions;
    const u = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]], w = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
    const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
    for (const corner of [a, b, c]) for (let k = 0; k < 3; ++k) normals[corner + k] += n[k];
  }
  const shapes = new Int16Array(4 * vertices);
  for (let v = 0; v < vertices; ++v) {
    const length = Math.hypot(normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]) || 1;
    for (let k = 0; k < 3; ++k) shapes[4 * v + k] = Math.round(32767 * normals[3 * v + k] / length);
    shapes[4 * v + 3] = head.getInt16(at, true);
    at += 2;
  }
  return {frame: 0, blocks: [{key: 'all', positions, shapes, indices}]};
};

// The rows of a session: columns by name, times in seconds.
View.Rows = class {
  constructor(columns, times, values) {
    this.width = columns.length;
    this.column = Object.fromEntries(columns.map((name, i) => [name, i]));
    this.times = times;
    this.values = values;
  }
  static read(columns, rows, buffer) {
    return new View.Rows(columns, new Float64Array(buffer, 0, rows), new Float32Array(buffer, 8 * rows, rows * columns.length));
  }
  get length() { return this.times.length; }
  at(row, name) { return this.values[row * this.width + this.column[name]]; }
  vector(row, name) {
    const first = row * this.width + this.column[`${name}_x`];
    return [this.values[first], this.values[first + 1], this.values[first + 2]];
  }
  quaternion(row, name) {  // x, y, z, w
    const first = row * this.width + this.column[`${name}_qx`];
    return Array.from(this.values.subarray(first, first + 4));
  }
  length3(row, name) { return Math.hypot(...this.vector(row, name)); }
  lag(row) {
    const bur = this.vector(row, 'bur'), handle = this.vector(row, 'handle');
    return Math.hypot(bur[0] - handle[0], bur[1] - handle[1], bur[2] - handle[2]);
  }
  removed(row) {
    const first = row * this.width + this.column.removed_enamel;
    return this.values[first] + this.values[first + 1] + this.values[first + 2] + this.values[first + 3];
  }
  contact(row) {
    const first = row * this.width + this.column.area_enamel;
    return this.values[first] + this.values[first + 1] + this.values[first + 2] + this.values[first + 3];
  }
  // mm^3/s over the last 0.1 s: single steps jump by the voxel.
  removalRate(row) {
    const from = this.find(this.times[row] - 0.1);
    return from < row ? (this.removed(row) - this.removed(from)) / (this.times[row] - this.times[from]) : 0;
  }
  // The last row whose time is at most `time`; 0 before the first.
  find(time) {
    let low = 0, high = this.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.times[middle] <= time + 1e-9) low = middle; else high = middle;
    }
    return low;
  }
};

// The rows of a session that runs, as they come; the oldest go when there are too many.
View.LiveRows = class extends View.Rows {
  constructor(columns, capacity = 36000) {  // ten minutes at 60 Hz
    super(columns, new Float64Array(capacity), new Float32Array(capacity * columns.length));
    this.count = 0;
  }
  get length() { return this.count; }
  add(time, values) {
    if (this.count > 0 && time <= this.times[this.count - 1]) return;
    if (this.count === this.times.length) {
      const kept = this.count >> 1, gone = this.count - kept;
      this.times.copyWithin(0, gone);
      this.values.copyWithin(0, gone * this.width);
      this.count = kept;
    }
    this.times[this.count] = time;
    this.values.set(values, this.count * this.width);
    ++this.count;
  }
};

// A message of the feed of a session that runs (live_scene.cpp): {row} or {blocks}.
View.readMessage = (buffer, columns) => {
  const head = new DataView(buffer);
  switch (head.getInt32(0, true)) {
    case 1: return {row: {time: head.getFloat64(8, true), world: head.getFloat64(16, true), values: new Float32Array(buffer, 24, columns)}};
    case 2: return {blocks: View.readBlocks(buffer, 4)};
    case 3: return {state: JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4)))};
    default: throw new Error('the server sent a message of another version');
  }
};
