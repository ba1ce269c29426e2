// What is heard: the drill, whose pitch follows the rotation rate, and a sound of each lamp. All of it off until asked for.
'use strict';

const kDrillHz = 420;  // at the rate without load: true rates are too low or too high to be heard well
const kLampSounds = {  // Hz, beats a second
  stall: [196, 8], shank: [311, 4], pulp: [880, 6], limit: [523, 2], heat: [262, 1], fault: [988, 10], paused: [147, 0.5],
};

View.Sound = class {
  constructor(facts) {
    this.facts = facts;
    this.on = false;
    this.muted = new Set();  // lamps whose sound is off
    this.sounding = [];
    this.drill = 0;          // Hz
  }

  // Only after a click: browsers ask for one.
  turn(on) {
    this.on = on;
    if (on && !this.context) this.build();
    if (this.context) on ? this.context.resume() : this.context.suspend();
    if (!on) { this.sounding = []; this.drill = 0; }
  }

  build() {
    const context = this.context = new AudioContext();
    const voice = (type, hz, loudness) => {
      const tone = new OscillatorNode(context, {type, frequency: hz}), gain = new GainNode(context, {gain: 0});
      tone.connect(gain).connect(context.destination);
      tone.start();
      return {tone, gain, loudness};
    };
    this.motor = voice('sawtooth', kDrillHz, 0.04);
    this.voices = Object.fromEntries(Object.entries(kLampSounds).map(([name, [hz, beats]]) => {
      const lamp = voice('triangle', hz, 0.12);
      const beat = new OscillatorNode(context, {type: 'square', frequency: beats}), depth = new GainNode(context, {gain: 0});
      beat.connect(depth).connect(lamp.gain.gain);
      beat.start();
      return [name, {...lamp, depth}];
    }));
  }

  // A row: `lamps` as Instruments has them.
  show(rows, row, lamps, moving) {
    if (!this.on) return;
    const now = this.context.currentTime, turns = rows.at(row, 'stalled') > 0 ? 0 : rows.at(row, 'rotation_rate') / (this.facts.rotation_rate || 1);
    this.drill = moving ? kDrillHz * turns : 0;
    if (turns > 0) this.motor.tone.frequency.setTargetAtTime(kDrillHz * turns, now, 0.03);
    this.motor.gain.gain.setTargetAtTime(this.drill > 0 ? this.motor.loudness : 0, now, 0.03);
    this.sounding = Object.keys(this.voices).filter((name) => moving && lamps[name] && !this.muted.has(name));
    for (const [name, {gain, depth, loudness}] of Object.entries(this.voices)) {
      const level = this.sounding.includes(name) ? loudness / 2 : 0;
      gain.gain.setTargetAtTime(level, now, 0.02);
      depth.gain.setTargetAtTime(level, now, 0.02);
    }
  }
};
