// The whole session in a line: force over time, stalls marked, a place to drag; and what to jump to.
'use strict';

const kPoints = 3000;      // of the curve
const kApart = 0.5;        // s, between two peaks
const kManyPeaks = 20;
const kPause = 0.2;        // s without contact, after which the next one is another

// Times of {stalls, contacts, peaks}: where they begin, and where the force is largest.
View.moments = (rows) => {
  const moments = {stalls: [], contacts: [], peaks: []};
  let contactEnd = -Infinity;
  const candidates = [];
  for (let i = 1; i < rows.length; ++i) {
    if (rows.at(i, 'stalled') > 0 && !(rows.at(i - 1, 'stalled') > 0)) moments.stalls.push(rows.times[i]);
    if (rows.contact(i) > 0) {
      if (rows.times[i] - contactEnd > kPause) moments.contacts.push(rows.times[i]);
      contactEnd = rows.times[i];
    }
    candidates.push([rows.length3(i, 'force'), rows.times[i]]);
  }
  // The largest, then the largest that is not near it, and so on: by bins, which are few.
  const bins = new Map();
  for (const candidate of candidates) {
    const bin = Math.floor(candidate[1] / kApart), best = bins.get(bin);
    if (!best || candidate[0] > best[0]) bins.set(bin, candidate);
  }
  for (const [force, time] of [...bins.values()].sort((a, b) => b[0] - a[0])) {
    if (force <= 0 || moments.peaks.length === kManyPeaks) break;
    if (moments.peaks.every((other) => Math.abs(other - time) >= kApart)) moments.peaks.push(time);
  }
  moments.peaks.sort((a, b) => a - b);
  return moments;
};

View.Timeline = class {
  constructor(rows, facts, seek, other = null) {
    this.rows = rows;
    this.other = other;
    this.time = rows.times[0];
    this.moments = View.moments(rows);
    const stalls = this.stallSpans();
    this.graph = new Dygraph(document.getElementById('line-plot'), this.curve(), {
      labels: ['time', 'force, N', 'other'], legend: 'never', interactionModel: this.dragging(seek), gridLineColor: '#3c4851',
      axisLineColor: '#3c4851', axisLabelFontSize: 11, colors: ['#ff8a70', '#7dff8a'], includeZero: true, fillGraph: true,
      highlightCircleSize: 0, axes: {y: {axisLabelWidth: 36}, x: {axisLabelFormatter: (t) => `${t} s`}},
      underlayCallback: (context, area, graph) => {
        context.fillStyle = '#e04a3588';
        for (const [from, to] of stalls) {
          const left = graph.toDomXCoord(from);
          context.fillRect(left, area.y, Math.max(2, graph.toDomXCoord(to) - left), area.h);
        }
      },
    });
    for (const [name, times] of Object.entries(this.moments)) this.addJump(name, times, seek);
    new ResizeObserver(() => { this.graph.resize(); this.show(this.time); }).observe(document.getElementById('line'));
  }

  // The largest force in each of some thousand parts, so that no peak is lost.
  curve() {
    const {rows} = this, step = Math.max(1, Math.ceil(rows.length / kPoints)), points = [];
    for (let i = 0; i < rows.length; i += step) {
      const last = Math.min(i + step, rows.length) - 1;
      points.push([rows.times[i], this.most(rows, i, last), this.other && this.of(rows.times[i], rows.times[last])]);
    }
    return points;
  }
  most(rows, from, to) {
    let most = 0;
    for (let k = from; k <= to; ++k) most = Math.max(most, rows.length3(k, 'force'));
    return most;
  }
  of(from, to) {  // of the other recording, between two times
    if (from > this.other.times[this.other.length - 1]) return null;
    return this.most(this.other, this.other.find(from), this.other.find(to));
  }

  stallSpans() {
    const {rows} = this, spans = [];
    for (let i = 0; i < rows.length; ++i) {
      if (!(rows.at(i, 'stalled') > 0)) continue;
      const last = spans[spans.length - 1];
      if (last && rows.times[i] - last[1] < 0.05) last[1] = rows.times[i]; else spans.push([rows.times[i], rows.times[i]]);
    }
    return spans;
  }

  dragging(seek) {
    const to = (event, graph) => seek(graph.toDataXCoord(graph.eventToDomCoords(event)[0]));
    return {
      mousedown: (event, graph) => { this.held = true; to(event, graph); event.preventDefault(); },
      mousemove: (event, graph) => { if (this.held && event.buttons) to(event, graph); },
      mouseup: () => { this.held = false; },
    };
  }

  addJump(name, times, seek) {
    const jumps = document.getElementById('jumps');
    const button = (sign, label, choose) => {
      const element = document.createElement('button');
      element.textContent = sign;
      element.id = `${label}-${name}`;
      element.setAttribute('aria-label', `${label} of ${name}`);
      element.disabled = times.length === 0;
      element.addEventListener('click', () => { const time = choose(); if (time !== undefined) seek(time); });
      return element;
    };
    const label = document.createElement('span');
    label.textContent = `${name} (${times.length})`;
    const now = () => this.time;
    jumps.append(button('◀', 'previous', () => [...times].reverse().find((t) => t < now() - 1e-6)), label,
      button('▶', 'next', () => times.find((t) => t > now() + 1e-6)));
  }

  show(time) {
    this.time = time;
    document.getElementById('cursor').style.left = `${this.graph.toDomXCoord(time)}px`;
  }
};
