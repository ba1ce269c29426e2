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

// The rows of a session: columns by name, times in seconds.
View.Rows = class {
  constructor(columns, times, values) {
    this.width = columns.length;
    this.column = Object.fromEntries(columns.map((name, i) => [name, i]));
    this.times = times;
    this.values = values;
  }
  static read(scene, buffer) {
    return new View.Rows(scene.columns, new Float64Array(buffer, 0, scene.rows),
      new Float32Array(buffer, 8 * scene.rows, scene.rows * scene.columns.length));
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
    default: throw new Error('the server sent a message of another version');
  }
};
