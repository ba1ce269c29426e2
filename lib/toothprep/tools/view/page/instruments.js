// Numbers, lamps and the plots of the last seconds.
'use strict';

const kWindow = 10;         // s, of the plots
const kPlotEvery = 200;     // ms
const kLimited = 1 | 2, kHeat = 4, kWithheld = 8 | 32, kRejected = 128;  // core/live_tick.h

// Each from a row: true, false, or null where the recording doesn't say.
View.lamps = {
  stall: (r, i) => r.at(i, 'stalled') > 0,
  shank: (r, i) => r.at(i, 'shank_area') > 0,
  pulp: (r, i) => r.at(i, 'area_pulp') > 0,
  limit: (r, i, session) => session ? (r.at(i, 'flags') & kLimited) !== 0 : null,
  heat: (r, i, session) => session ? (r.at(i, 'flags') & kHeat) !== 0 : null,
  fault: (r, i, session) => session ? r.at(i, 'fault') !== 0 || (r.at(i, 'flags') & (kWithheld | kRejected)) !== 0 : null,
  paused: (r, i, session) => session ? (r.at(i, 'flags') & 2048) !== 0 : null,
};
const kMild = ['limit', 'heat', 'paused'];

// Legends are not used here, and theirs are made of inline styles, which the page's policy refuses.
Dygraph.PLUGINS = Dygraph.PLUGINS.filter((plugin) => plugin !== Dygraph.Plugins.Legend);

View.quantities = (facts) => [
  {name: 'force', unit: 'N', digits: 2, of: (r, i) => r.length3(i, 'force')},
  {name: 'torque', unit: 'mN·m', digits: 2, of: (r, i) => r.at(i, 'torque'), limit: facts.stall_torque},
  {name: 'speed', unit: 'rpm', digits: 0, of: (r, i) => 60 * r.at(i, 'rotation_rate')},
  {name: 'removal', unit: 'mm³/s', digits: 2, of: (r, i) => r.removalRate(i)},
  {name: 'lag', unit: 'mm', digits: 2, of: (r, i) => r.lag(i)},
];

View.Instruments = class {
  constructor(facts, sound) {
    this.facts = facts;
    this.quantities = View.quantities(facts);
    this.plotted = 0;
    const make = (parent, tag, text, kind) => {
      const element = document.createElement(tag);
      element.textContent = text;
      if (kind) element.className = kind;
      document.getElementById(parent).append(element);
      return element;
    };
    this.lamps = Object.keys(View.lamps).map((name) => [name, make('lamps', 'li', name)]);
    this.lampStates = {};
    for (const [name, element] of this.lamps) {  // a click switches its sound
      element.id = `lamp-${name}`;
      element.addEventListener('click', () => {
        sound.muted.has(name) ? sound.muted.delete(name) : sound.muted.add(name);
        element.classList.toggle('mute', sound.muted.has(name));
      });
    }
    this.values = this.quantities.map((q) => {
      make('numbers', 'dt', q.name);
      const value = make('numbers', 'dd', '');
      make('numbers', 'dd', q.limit ? `of ${q.limit} ${q.unit}` : q.unit, 'unit');
      return value;
    });
    this.removed = facts.tissues.slice(1).map((tissue) => {
      make('removed', 'dt', tissue.name);
      return make('removed', 'dd', '');
    });
    if (facts.session) {
      make('numbers', 'dt', 'missed ticks');
      this.missed = make('numbers', 'dd', '', 'small');
      make('numbers', 'dd', '', 'unit');
    }
    new ResizeObserver(() => this.plots.forEach(({graph}) => graph.resize())).observe(document.getElementById('plots'));
    this.plots = this.quantities.filter((q) => q.name !== 'speed').map((q) => this.addPlot(q));
  }

  addPlot(quantity) {
    const title = document.createElement('h2'), box = document.createElement('div');
    title.textContent = `${quantity.name}, ${quantity.unit}` + (quantity.limit ? ' (line: stall torque)' : '');
    box.className = 'plot';
    document.getElementById('plots').append(title, box);
    const graph = new Dygraph(box, [[0, 0, quantity.limit || null, null]], {
      labels: ['time', quantity.name, 'limit', 'other'], legend: 'never', interactionModel: {}, drawGrid: true, gridLineColor: '#3c4851',
      axisLineColor: '#3c4851', axisLabelFontSize: 11, colors: ['#7fd0ff', '#ff5a3c', '#7dff8a'], strokeWidth: 1.3, includeZero: true,
      highlightCircleSize: 0, axes: {y: {axisLabelWidth: 36, pixelsPerLabel: 20}},
    });
    return {quantity, graph};
  }

  show(rows, row) {
    document.getElementById('clock').textContent = `${rows.times[row].toFixed(3)} s`;
    this.quantities.forEach((q, i) => { this.values[i].textContent = q.of(rows, row).toFixed(q.digits); });
    this.removed.forEach((element, k) => {
      element.textContent = rows.at(row, `removed_${this.facts.tissues[k + 1].name}`).toFixed(3);
    });
    if (this.missed) this.missed.textContent = rows.at(row, 'missed').toFixed(0);
    for (const [name, element] of this.lamps) {
      const on = View.lamps[name](rows, row, this.facts.session);
      this.lampStates[name] = on;
      element.classList.toggle('unknown', on === null);
      element.classList.toggle('on', on === true);
      element.classList.toggle('mild', on === true && kMild.includes(name));
      element.title = on === null ? 'known of live sessions only' : 'a click switches its sound off or on';
    }
  }

  // The plots of the last seconds, now and then, and of the last row that was given.
  plot(rows, row, other = null) {
    const early = this.plotted + kPlotEvery - performance.now();
    clearTimeout(this.later);
    if (early > 0) {
      this.later = setTimeout(() => this.plot(rows, row, other), early);
      return;
    }
    this.plotted = performance.now();
    const to = rows.times[row], from = rows.find(to - kWindow);
    const step = Math.max(1, Math.floor((row - from) / 300));
    for (const {quantity, graph} of this.plots) {
      const points = [];
      const beside = (time) => other && time <= other.times[other.length - 1] ? quantity.of(other, other.find(time)) : null;
      for (let i = from; i <= row; i += step) points.push([rows.times[i], quantity.of(rows, i), quantity.limit || null, beside(rows.times[i])]);
      if (points.length === 0) points.push([to, 0, quantity.limit || null, null]);
      graph.updateOptions({file: points, dateWindow: [to - kWindow, to]});
    }
  }
};
