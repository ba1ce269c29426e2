// Puts the parts together: what is shown, when, and from which of the server's answers.
'use strict';

const kPatience = 100;  // ms

(async () => {
  const byId = (id) => document.getElementById(id);
  const message = (text) => { byId('message').textContent = text; };
  const errors = [];
  const fail = (error) => {
    errors.push(String(error && error.message || error));
    message(errors[errors.length - 1]);
  };
  window.addEventListener('error', (event) => fail(event.error || event.message));
  window.addEventListener('unhandledrejection', (event) => fail(event.reason));

  const facts = await View.json('scene');
  document.title = `${facts.layers[facts.layers.length - 1]} · toothprep`;
  const picture = new View.Picture(byId('picture'), facts);
  const replays = facts.kind === 'replay', live = facts.kind === 'live';
  const layer = facts.layers.length - 1;
  const now = picture.surfaces.now, before = picture.surfaces.before;
  let rows = null, instruments = null, timeline = null, progress = null;
  const sound = new View.Sound(facts);
  const frameRows = replays ? [] : [0];
  const play = {time: 0, row: 0, playing: false, speed: 1, turned: 0};
  let asking = false, askedAt = 0, arrived = false, settled = [], control = null, other = null;

  // ---- The tooth as it was

  const frameAt = (row) => {  // the last frame that is not later than the row of the page
    const last = replays && row === rows.length - 1 && progress && progress.finished;
    if (last) return frameRows.length - 1;
    let low = 0, high = frameRows.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (frameRows[middle] <= row * facts.stride) low = middle; else high = middle;
    }
    return low;
  };
  const wantedFrame = () => (replays ? frameAt(play.row) : 0);
  const reached = (row) => frameRows.length > 0 &&
    (progress && progress.finished || row * facts.stride <= frameRows[frameRows.length - 1]);

  // One request at a time, always for what is wanted by then.
  const updateSurface = async () => {
    if (asking || live || frameRows.length === 0 || wantedFrame() === now.frame) return;
    asking = true;
    askedAt = performance.now();
    try {
      const frame = wantedFrame();
      now.update(View.readBlocks(await View.bytes(`blocks?layer=${layer}&frame=${frame}&seen=${now.frame}`)));
      picture.changed = arrived = true;
    } finally {
      asking = false;
    }
  };

  const loadBefore = async () => {
    if (before.frame >= 0) return;
    before.frame = 0;
    const other = facts.layers.length > 1 ? layer - 1 : layer;
    before.update(View.readBlocks(await View.bytes(`blocks?layer=${other}&frame=0&seen=-1`)));
    picture.changed = true;
  };

  const followProgress = async () => {
    progress = await View.json(`progress?from=${frameRows.length}`);
    frameRows.push(...progress.frame_rows);
    const {finished, failure, done, bur_difference_mm: away, force_difference_n: stronger} = progress;
    message(finished ? '' : `recomputing the tooth: ${Math.floor(100 * done)} %`);
    if (failure) fail(`the tooth can't be recomputed: ${failure}`);
    if (finished && !failure)
      byId('note').textContent = away === 0 && stronger === 0 ?
        'The tooth was recomputed; bur and force are those of the recording to the last bit.' :
        `The tooth was recomputed; the bur is up to ${away.toPrecision(2)} mm, the force up to ${stronger.toPrecision(2)} N off the recording: another version or other parameters made it.`;
    if (!finished) setTimeout(() => followProgress().catch(fail), 100);
  };

  // ---- A session that runs

  const watched = {connected: false, messages: 0, latencies: []};
  const connect = () => {
    const address = new URL('feed', document.location.href.replace(/^http/, 'ws'));
    const feed = new WebSocket(address);
    feed.binaryType = 'arraybuffer';
    feed.onopen = () => {
      watched.connected = true;
      message(rows.length ? '' : 'waiting for the session to begin: hold the stylus so that the bur is clear of the tooth');
    };
    feed.onmessage = ({data}) => {
      ++watched.messages;
      const {row, blocks, state} = View.readMessage(data, facts.columns.length);
      if (state) {
        watched.control = {...watched.control, refused: undefined, ...state};
        if (control) control.show(state);
        if (control && facts.burs[state.bur]) picture.setBur(facts.burs[state.bur]);
        return;
      }
      if (blocks) {
        now.update(blocks);
        picture.changed = true;
        return;
      }
      if (rows.length === 0) message('');
      rows.add(row.time, row.values);
      watched.world = row.world;
    };
    watched.send = (command) => feed.send(JSON.stringify(command));
    feed.onclose = () => {
      if (watched.connected || watched.messages === 0)
        message(watched.messages ? 'the session has ended, or does not answer' : 'not connected');
      watched.connected = false;
      setTimeout(connect, 1000);
    };
  };
  const showNewest = (seconds) => {
    if (rows.length === 0 || rows.times[rows.length - 1] === play.time) return;
    play.time = rows.times[rows.length - 1];
    turn(rows.length - 1, seconds);
    showRow(rows.length - 1);
    byId('guidance').textContent = View.guidance(facts, rows, rows.length - 1);
    instruments.plot(rows, rows.length - 1);
    const world = performance.timeOrigin + performance.now();
    watched.latencies.push(world - watched.world);
    if (watched.latencies.length > 1000) watched.latencies.shift();
  };

  // ---- Time

  const showRow = (row) => {
    play.row = row;
    if (facts.events.length) picture.setBur(facts.burs[View.burAt(facts, rows.times[row])] || facts.bur);
    picture.setRow(rows, row, play.turned);
    if (other) picture.setOther(other, other.find(rows.times[row]));
    instruments.show(rows, row);
    sound.show(rows, row, instruments.lampStates, live || play.playing);
    if (picture.mirror && facts.columns.includes('mirror_x')) picture.mirror.follow(rows.vector(row, 'mirror'), rows.quaternion(row, 'mirror'));
  };
  const seek = (time) => {
    const end = rows.times[rows.length - 1];
    play.time = Math.min(Math.max(time, rows.times[0]), end);
    showRow(rows.find(play.time));
    timeline.show(play.time);
    instruments.plot(rows, play.row, other);
    return new Promise((resolve) => settled.push(resolve));
  };
  const setPlaying = (playing) => {
    if (playing && play.time >= rows.times[rows.length - 1]) seek(rows.times[0]);
    play.playing = playing;
    byId('play').textContent = playing ? '❚❚' : '▶';
    byId('play').setAttribute('aria-label', playing ? 'pause' : 'play');
  };

  let last = performance.now();
  const turnsShown = 1.5;  // a second at full speed: true turns would not be seen
  const turn = (row, seconds) => {
    const rate = rows.at(row, 'rotation_rate') / (facts.rotation_rate || 1);
    if (!(rows.at(row, 'stalled') > 0)) play.turned += 2 * Math.PI * turnsShown * rate * seconds;
  };
  const advance = (seconds) => {
    if (!play.playing) return;
    turn(play.row, seconds);
    seek(play.time + play.speed * seconds);
    if (play.time >= rows.times[rows.length - 1]) setPlaying(false);
  };

  // ---- What lies over the picture

  const overlay = () => {
    const label = byId('force-label'), end = picture.forceEnd && picture.onScreen(picture.forceEnd);
    label.hidden = !end || picture.stereo !== 'off' || picture.inHeadset;
    if (end) {
      label.textContent = `${rows.length3(play.row, 'force').toFixed(2)} N`;
      label.style.transform = `translate(${end[0] + 8}px, ${end[1] - 14}px)`;
    }
    const scale = picture.pixelsPerMm(), mm = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((l) => l * scale >= 70) || 50;
    byId('scale-bar').style.width = `${mm * scale}px`;
    byId('scale-text').textContent = `${mm} mm`;
    byId('wipe-line').hidden = picture.wipe === 0;
    byId('wipe-line').style.left = `${100 * picture.wipe}%`;
  };

  const step = (time) => {
    const seconds = Math.min(0.25, Math.max(0, (time - last) / 1000));
    last = time;
    if (replays && rows) advance(seconds);
    if (live && rows) showNewest(seconds);
    const drawable = arrived;
    arrived = false;
    updateSurface().catch(fail);
    // The bur waits a little for the tooth of the same moment: one picture of both instead of two.
    const waits = asking && !drawable && performance.now() - askedAt < kPatience;
    if ((picture.inHeadset || !waits) && picture.draw(picture.inHeadset)) overlay();
    if (settled.length && !asking && (live || wantedFrame() === now.frame && reached(play.row))) {
      const done = settled;
      settled = [];
      done.forEach((resolve) => resolve(state()));
    }
  };

  const onFrame = (time) => {
    requestAnimationFrame(onFrame);
    if (!picture.inHeadset) step(time);  // a headset has a beat of its own, and may stop this one
  };

  // ---- Controls

  for (const name of ['oblique', 'occlusal', 'buccal', 'lingual', 'mesial', 'distal', 'apical']) {
    const button = document.createElement('button');
    button.textContent = name;
    button.id = `view-${name}`;
    button.addEventListener('click', () => picture.look(name));
    byId('views').append(button, ' ');
  }
  const setSection = (change) => {
    Object.assign(picture.section, change);
    byId('section').value = picture.section.kind;
    byId('section-follows').checked = picture.section.follows;
    byId('section-offset').value = picture.section.offset;
    byId('section-offset').disabled = picture.section.kind === 'off' || (picture.section.follows && Boolean(facts.bur));
    picture.changed = true;
  };
  byId('section').addEventListener('change', (event) => setSection({kind: event.target.value}));
  byId('section-offset').addEventListener('input', (event) => setSection({offset: Number(event.target.value)}));
  byId('section-follows').addEventListener('change', (event) => setSection({follows: event.target.checked}));
  const setWipe = (share) => {
    byId('wipe').value = share;
    picture.setWipe(share);
    return share > 0 ? loadBefore() : Promise.resolve();
  };
  byId('wipe').addEventListener('input', (event) => setWipe(Number(event.target.value)).catch(fail));
  byId('play').addEventListener('click', () => setPlaying(!play.playing));
  byId('speed').addEventListener('change', (event) => { play.speed = Number(event.target.value); });
  window.addEventListener('keydown', (event) => {
    if (!replays || event.target.tagName === 'INPUT' || event.target.tagName === 'SELECT') return;
    const step = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (event.key === ' ' && event.target.tagName !== 'BUTTON') setPlaying(!play.playing);
    else if (step) seek(play.time + step * (event.shiftKey ? 1 : 0.05));
    else return;
    event.preventDefault();
  });
  new ResizeObserver(() => picture.resize()).observe(byId('stage'));

  for (const tissue of facts.tissues.slice(1)) {
    const item = document.createElement('li'), patch = document.createElement('i');
    patch.style.background = `#${new THREE.Color(...tissue.colour).convertLinearToSRGB().getHexString()}`;
    item.append(patch, tissue.name);
    byId('legend').append(item);
  }
  const setStereo = (kind) => picture.setStereo(byId('stereo').value = kind);
  const setMirror = (on) => picture.setMirror(byId('mirror').checked = on);
  byId('stereo').addEventListener('change', (event) => setStereo(event.target.value));
  byId('mirror').addEventListener('change', (event) => setMirror(event.target.checked));
  byId('sound').addEventListener('change', (event) => sound.turn(event.target.checked));
  byId('sound-label').classList.toggle('absent', !facts.bur);
  View.offerHeadset(picture, byId('stage'), step).catch(fail);
  if (facts.deviation) View.offerDeviation(facts, picture);
  byId('transport').classList.toggle('absent', !replays);
  byId('panel').classList.toggle('absent', !facts.bur);
  byId('follow-label').classList.toggle('absent', !facts.bur);
  byId('wipe-label').classList.toggle('absent', !replays && facts.layers.length < 2);
  if (!facts.bur) document.body.style.gridTemplateColumns = 'minmax(0, 1fr)';

  // ---- For tests and scripts

  const state = () => {
    const row = rows && rows.length && instruments ? {
      time: rows.times[play.row], row: play.row, bur: rows.vector(play.row, 'bur'), handle: rows.vector(play.row, 'handle'),
      force: rows.vector(play.row, 'force'), force_n: rows.length3(play.row, 'force'), torque: rows.at(play.row, 'torque'),
      lag_mm: rows.lag(play.row), stalled: rows.at(play.row, 'stalled') > 0, removed_mm3: rows.removed(play.row),
      lamps: {...instruments.lampStates},
      other: other ? {time: other.times[other.find(rows.times[play.row])], bur: other.vector(other.find(rows.times[play.row]), 'bur')} : null,
    } : {};
    return {
      kind: facts.kind, ready, errors: [...errors], playing: play.playing, speed: play.speed, rows: rows ? rows.length : 0,
      triangles: now.triangles, triangles_before: before.triangles, frame: now.frame, generation: now.frame,
      frame_row: replays ? frameRows[now.frame] : 0, frames: frameRows.length,
      recomputed: progress ? {...progress, frame_rows: undefined} : null, moments: timeline ? timeline.moments : null,
      section: {...picture.section}, stereo: picture.stereo, headset: picture.inHeadset,
      mirror: picture.mirror ? {position: picture.mirror.group.position.toArray(), reflections: picture.mirror.reflections} : null,
      sound: {on: sound.on, drill_hz: sound.drill, sounding: [...sound.sounding], muted: [...sound.muted]}, live: live ? {...watched, send: undefined} : null, bur_name: picture.shownBur ? picture.shownBur.name : null, wipe: picture.wipe, pictures: picture.frames,
      camera: {position: picture.camera.position.toArray(), target: picture.controls.target.toArray()}, ...row,
    };
  };
  let ready = false;
  window.toothprep = {state, seek, play: setPlaying, look: (name) => picture.look(name), lookAtBur: () => picture.lookAtBur(),
    onScreen: (place) => picture.onScreen(new THREE.Vector3(...place)),
    section: setSection, wipe: setWipe, stereo: setStereo, mirror: setMirror, control: (command) => watched.send(command)};

  // ---- Begin

  requestAnimationFrame(onFrame);
  if (replays) {
    rows = View.Rows.read(facts.columns, facts.rows, await View.bytes('trace'));
    if (facts.other_rows) other = View.Rows.read(facts.columns, facts.other_rows, await View.bytes('other'));
    instruments = new View.Instruments(facts, sound);
    timeline = new View.Timeline(rows, facts, seek, other);
    await followProgress();
    seek(rows.times[0]);
  }
  if (live) {
    rows = new View.LiveRows(facts.columns);
    instruments = new View.Instruments(facts, sound);
    if (facts.control) control = new View.Control(facts, (command) => watched.send(command));
    connect();
  }
  if (facts.volume) picture.setVolume(new Uint8Array(await View.bytes('tissues')));
  if (!replays && !live) message('');
  if (facts.layers.length > 1 && !replays) await setWipe(0.5);
  await new Promise((resolve) => settled.push(resolve));
  ready = true;
})().catch((error) => {
  document.getElementById('message').textContent = error.message;
  console.error(error);
});
