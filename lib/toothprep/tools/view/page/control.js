// What the page may do to a session that runs (live --view --control), and how it begins.
'use strict';

const kPaused = 2048, kLocked = 256;  // core/live_tick.h

// The bur of a moment: its place in the list of those that the session could change to.
View.burAt = (facts, time) => {
  let bur = 0;
  for (const event of facts.events) if (event.kind === 'bur' && event.time <= time + 1e-9) bur = event.bur;
  return bur;
};

// "4.2 mm occlusal, 1.0 mm mesial": how far outside of the tooth's box along its axes; '' inside.
View.outsideOf = (facts, place) => {
  const corners = [0, 1].flatMap((x) => [0, 1].flatMap((y) => [0, 1].map((z) => [facts.bounds[x][0], facts.bounds[y][1], facts.bounds[z][2]])));
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const parts = [];
  for (const [to, from] of [['occlusal', 'apical'], ['mesial', 'distal'], ['buccal', 'lingual']]) {
    const along = corners.map((c) => dot(c, facts.axes[to])), at = dot(place, facts.axes[to]);
    const beyond = at - Math.max(...along), before = Math.min(...along) - at;
    if (beyond > 0.05) parts.push(`${beyond.toFixed(1)} mm ${to}`);
    if (before > 0.05) parts.push(`${before.toFixed(1)} mm ${from}`);
  }
  return parts.join(', ');
};

// What the operator has to do or to know, of the newest row of a session that runs.
View.guidance = (facts, rows, row) => {
  const flags = rows.at(row, 'flags');
  const outside = View.outsideOf(facts, rows.vector(row, 'bur'));
  const where = outside ? `the bur is ${outside} of the tooth` : 'the bur is at the tooth';
  if (flags & kPaused) return 'paused: no force, nothing is cut';
  if (flags & kLocked)
    return `${where}; the motor waits: keep the bur clear of the tooth for half a second, or release the pedal and press it again`;
  return rows.removed(row) > 0 || rows.contact(row) > 0 ? '' : `${where}; ${outside ? 'move it to the tooth' : 'it cuts where it touches'}`;
};

View.Control = class {
  constructor(facts, send) {
    this.send = send;
    this.state = {state: 'starting', bur: 0, undoable: 0, note: ''};
    const byId = (id) => document.getElementById(id);
    byId('control').hidden = false;
    this.buttons = {};
    for (const [name, text] of [['pause', 'pause'], ['resume', 'go on'], ['undo', 'undo to the last pause'], ['end', 'end the session']]) {
      const button = this.buttons[name] = byId(`do-${name}`);
      button.textContent = text;
      button.addEventListener('click', () => {
        if (name !== 'end' || this.sure) return this.send({do: name});
        this.sure = true;  // a second press within three seconds
        button.textContent = 'press again to end';
        setTimeout(() => { this.sure = false; button.textContent = text; }, 3000);
      });
    }
    this.bur = byId('do-bur');
    facts.burs.forEach((bur, i) => this.bur.add(new Option(bur.name, i)));
    this.bur.addEventListener('change', () => this.send({do: 'bur', bur: Number(this.bur.value)}));
    this.moves = [...document.querySelectorAll('#moves button')];
    for (const button of this.moves)
      button.addEventListener('click', () => {
        const {axis, mm, deg} = button.dataset;
        this.send({do: 'move', shift_mm: axis ? facts.axes[axis].map((c) => -Number(mm) * c) : [0, 0, 0], turn_deg: Number(deg || 0)});
      });
    this.show({});
  }
  show(change) {
    const {state, bur, note, undoable} = Object.assign(this.state, change);
    const paused = state === 'paused';
    this.buttons.pause.disabled = state !== 'running' && state !== 'resuming';
    this.buttons.resume.disabled = !paused;
    this.buttons.undo.disabled = !paused || undoable === 0;
    this.buttons.end.disabled = state === 'ending';
    this.bur.disabled = !paused;
    this.bur.value = bur;
    for (const button of this.moves) button.disabled = !paused;
    document.getElementById('control-state').textContent = change.refused || (note ? `${state}: ${note}` : state);
  }
};
