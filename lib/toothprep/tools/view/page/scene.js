// The picture: tooth, bur, handle, force, section; and from where they are seen. Places in mm, W.
'use strict';

const kForceLength = 2.5;   // mm per N, of the arrow
const kForceLeast = 0.005;  // N
const kCoarse = 0.5, kRest = 300;  // of the pixels' side; ms
const kHandpiece = {radius: 4.2, length: 12, grip: 5.5, gripLength: 60};  // mm: an outline, no model

// Whether pictures are made without a graphics processor: then smooth edges cost more than they are worth.
View.drawsBySoftware = () => {
  const trial = document.createElement('canvas').getContext('webgl2');
  const info = trial && trial.getExtension('WEBGL_debug_renderer_info');
  const name = info ? trial.getParameter(info.UNMASKED_RENDERER_WEBGL) : '';
  if (trial) trial.getExtension('WEBGL_lose_context').loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
};

View.Picture = class {
  constructor(canvas, scene) {
    this.software = View.drawsBySoftware();
    const context = canvas.getContext('webgl2', {antialias: !this.software, stencil: true});
    if (!context) throw new Error('this browser shows no 3-D pictures (WebGL 2)');
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({canvas, context});
    this.renderer.setClearColor(0x1d2328);
    this.three = new THREE.Scene();
    this.facts = scene;
    this.axes = Object.fromEntries(Object.entries(scene.axes).map(([k, v]) => [k, new THREE.Vector3(...v)]));
    const low = new THREE.Vector3(...scene.bounds[0]), high = new THREE.Vector3(...scene.bounds[1]);
    this.middle = low.clone().add(high).multiplyScalar(0.5);
    this.radius = 0.5 * high.distanceTo(low);
    this.camera = new THREE.PerspectiveCamera(25, 1, 1, 1000);
    this.camera.up.copy(this.axes.occlusal);
    this.rig = new THREE.Group();  // of a headset (stereo.js); else it leaves the camera where it is
    this.rig.add(this.camera);
    this.three.add(this.rig);
    this.inHeadset = false;
    const lamp = new THREE.DirectionalLight(0xffffff, 0.9);
    lamp.position.set(-0.4, 0.7, 1);
    this.camera.add(lamp);
    this.three.add(new THREE.AmbientLight(0xffffff, 0.45));
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.screenSpacePanning = true;
    this.controls.addEventListener('change', () => { this.changed = true; });
    this.surfaces = {now: new View.Surface(), before: new View.Surface()};
    for (const surface of Object.values(this.surfaces)) {
      surface.uniforms.colours.value = scene.tissues.map((t) => new THREE.Color(...t.colour));
      if (scene.deviation) surface.uniforms.ramp.value = scene.deviation.colours.map((c) => new THREE.Color(...c));
      surface.uniforms.volume.value = View.volumeTexture([1, 1, 1], new Uint8Array(4));
      this.three.add(surface.group);
    }
    this.surfaces.before.group.visible = false;
    this.face = View.sectionFace(this.surfaces.now.uniforms, 8 * this.radius);
    this.three.add(this.face);
    this.section = {kind: 'off', offset: 0, follows: true};
    this.wipe = 0;
    this.stereo = 'off';
    this.drawn = 0;
    this.frames = 0;
    this.changed = true;
    if (scene.bur) this.addBur(scene.bur);
    this.look('oblique');
  }

  setVolume(samples) {
    const v = this.facts.volume;
    for (const surface of Object.values(this.surfaces)) {
      const u = surface.uniforms;
      u.volume.value = View.volumeTexture(v.counts, samples);
      u.volumeOrigin.value.set(...v.origin).addScalar(-0.5 * v.spacing);
      u.volumeSize.value.set(...v.counts).multiplyScalar(v.spacing);
    }
    this.changed = true;
  }

  // ---- The bur and what belongs to it

  static solid(outline, material) {
    const points = outline.map(([r, z]) => new THREE.Vector2(r, z));
    const geometry = new THREE.LatheBufferGeometry(points, 48).rotateX(Math.PI / 2);  // its axis: z
    return new THREE.Mesh(geometry, material);
  }

  setBur(bur) {
    if (bur === this.shownBur) return;
    this.three.remove(this.bur, this.handle, this.lag, this.force);
    this.addBur(bur);
  }

  addBur(bur) {
    this.shownBur = bur;
    // Stripes that wind around the head, so that it is seen to turn.
    const stripes = new Uint8Array(3 * 32 * 32);
    for (let i = 0; i < 32 * 32; ++i) stripes.fill((i % 32 + (i >> 5)) % 16 < 8 ? 255 : 150, 3 * i, 3 * i + 3);
    const flutes = new THREE.DataTexture(stripes, 32, 32, THREE.RGBFormat);
    flutes.wrapS = flutes.wrapT = THREE.RepeatWrapping;
    flutes.repeat.set(3, 2);
    flutes.magFilter = THREE.LinearFilter;
    flutes.needsUpdate = true;
    const steel = {color: 0xb9c3cc, specular: 0x555555, shininess: 40, side: THREE.DoubleSide};
    this.head = View.Picture.solid(bur.outline, new THREE.MeshPhongMaterial({...steel, map: flutes}));
    this.bur = new THREE.Group();
    this.bur.add(this.head);
    const glass = new THREE.MeshBasicMaterial({color: 0x6db7ff, transparent: true, opacity: 0.28, depthWrite: false});
    this.handle = new THREE.Group();
    this.handle.add(View.Picture.solid(bur.outline, glass));
    let top = bur.head_length;
    if (bur.shank_radius > 0) {
      const r = bur.shank_radius, shank = [[0, bur.head_length], [r, bur.head_length], [r, bur.shank_top], [0, bur.shank_top]];
      this.bur.add(View.Picture.solid(shank, new THREE.MeshPhongMaterial(steel)));
      this.handle.add(View.Picture.solid(shank, glass));
      top = bur.shank_top;
    }
    this.bur.add(View.Picture.handpiece(top));
    this.lag = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({color: 0xffc857, depthTest: false, transparent: true}));
    this.lag.geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6), 3));
    this.lag.frustumCulled = false;
    const red = new THREE.MeshBasicMaterial({color: 0xff5a3c, depthTest: false, transparent: true});
    this.force = new THREE.Group();
    this.forceShaft = new THREE.Mesh(new THREE.CylinderBufferGeometry(0.05, 0.05, 1, 12).translate(0, 0.5, 0), red);
    this.forceTip = new THREE.Mesh(new THREE.ConeBufferGeometry(0.15, 0.4, 16).translate(0, 0.2, 0), red);
    this.force.add(this.forceShaft, this.forceTip);
    this.forceEnd = null;
    for (const part of [this.bur, this.handle, this.lag, this.force]) {
      part.visible = false;
      part.renderOrder = 2;  // after a section's face
      this.three.add(part);
    }
  }

  static handpiece(top) {
    const group = new THREE.Group(), h = kHandpiece;
    const cover = new THREE.MeshBasicMaterial({color: 0xffffff, transparent: true, opacity: 0.035, depthWrite: false, side: THREE.DoubleSide});
    const edge = new THREE.LineBasicMaterial({color: 0xffffff, transparent: true, opacity: 0.25});
    const head = new THREE.CylinderBufferGeometry(h.radius, h.radius, h.length, 32, 1).rotateX(Math.PI / 2)
      .translate(0, 0, top + h.length / 2);
    const grip = new THREE.CylinderBufferGeometry(h.grip, h.grip, h.gripLength, 32, 1, true)
      .translate(0, h.gripLength / 2, top + h.length / 2);
    for (const geometry of [head, grip]) {
      group.add(new THREE.Mesh(geometry, cover));
      group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 30), edge));
    }
    return group;
  }

  // Of a row of a session; `turned` is the head's angle, rad.
  setRow(rows, row, turned) {
    const bur = new THREE.Vector3(...rows.vector(row, 'bur')), handle = new THREE.Vector3(...rows.vector(row, 'handle'));
    this.bur.position.copy(bur);
    this.bur.quaternion.set(...rows.quaternion(row, 'bur'));
    this.head.rotation.z = -turned;  // clockwise, seen from the shank
    this.handle.position.copy(handle);
    this.handle.quaternion.set(...rows.quaternion(row, 'handle'));
    this.lag.geometry.attributes.position.array.set([...bur.toArray(), ...handle.toArray()]);
    this.lag.geometry.attributes.position.needsUpdate = true;
    const force = new THREE.Vector3(...rows.vector(row, 'force')), newtons = force.length();
    this.bur.visible = this.handle.visible = this.lag.visible = true;
    this.force.visible = newtons > kForceLeast;
    this.forceEnd = null;
    if (this.force.visible) {
      const length = kForceLength * newtons, tip = Math.min(1, 2 * length);  // a small one has a small tip
      this.force.position.copy(bur);
      this.force.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), force.clone().divideScalar(newtons));
      this.forceShaft.scale.set(tip, Math.max(length - 0.3 * tip, 1e-3), tip);
      this.forceTip.scale.setScalar(tip);
      this.forceTip.position.y = Math.max(length - 0.4 * tip, 0);
      this.forceEnd = bur.clone().add(force.multiplyScalar(length / newtons));
    }
    this.changed = true;
  }

  // The bur of another recording at the same time.
  setOther(rows, row) {
    if (!this.other) {
      const green = new THREE.MeshBasicMaterial({color: 0x7dff8a, transparent: true, opacity: 0.45, depthWrite: false});
      this.other = View.Picture.solid(this.shownBur.outline, green);
      this.other.renderOrder = 2;
      this.three.add(this.other);
    }
    this.other.position.set(...rows.vector(row, 'bur'));
    this.other.quaternion.set(...rows.quaternion(row, 'bur'));
  }

  // ---- Sections, before and after

  updateSection() {
    const {kind, offset, follows} = this.section;
    const plane = new THREE.Vector4(0, 0, 0, 0);
    this.face.visible = kind !== 'off';
    if (kind !== 'off') {
      const normal = this.axes[kind];
      const at = follows && this.bur && this.bur.visible ? this.bur.position : this.middle;
      const move = follows && this.bur && this.bur.visible ? 0 : offset * this.radius;
      plane.set(normal.x, normal.y, normal.z, normal.dot(at) + move);
      this.face.position.copy(this.middle).addScaledVector(normal, plane.w - normal.dot(this.middle));
      this.face.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal);
    }
    for (const surface of Object.values(this.surfaces)) {
      surface.uniforms.section.value = plane;
      surface.insides.visible = kind !== 'off';
    }
  }

  setStereo(kind) {
    this.stereo = kind;
    this.changed = true;
  }

  setMirror(on) {
    if (on === Boolean(this.mirror)) return;
    if (on) this.mirror = new View.Mirror(this);
    else { this.mirror.remove(); this.mirror = null; }
  }

  setDeviation(on) {
    this.surfaces.now.uniforms.deviates.value = on ? 1 : 0;
    this.changed = true;
  }

  setWipe(share) {
    this.wipe = share;
    this.changed = true;
  }

  // ---- Where it is seen from

  look(name) {
    const {occlusal, mesial, buccal} = this.axes;
    const from = {
      occlusal: occlusal.clone().addScaledVector(buccal, -1e-3), apical: occlusal.clone().negate().addScaledVector(buccal, -1e-3),
      buccal: buccal.clone(), lingual: buccal.clone().negate(), mesial: mesial.clone(), distal: mesial.clone().negate(),
      oblique: mesial.clone().add(buccal).normalize().multiplyScalar(0.82).addScaledVector(occlusal, 0.57),
    }[name];
    const distance = 1.08 * this.radius / Math.sin(THREE.Math.degToRad(this.camera.fov / 2));
    this.controls.target.copy(this.middle);
    this.camera.position.copy(this.middle).addScaledVector(from.normalize(), distance);
    this.camera.near = 0.02 * distance;
    this.camera.far = 4 * distance + 200;
    this.resize();
    this.controls.update();
    this.changed = true;
  }

  // Towards the bur, from where it is seen already.
  lookAtBur() {
    const away = this.camera.position.clone().sub(this.controls.target).setLength(30);
    this.controls.target.copy(this.bur.position);
    this.camera.position.copy(this.bur.position).add(away);
    this.controls.update();
    this.changed = true;
  }

  resize() {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width || !height || this.inHeadset) return;
    this.renderer.setPixelRatio((this.coarse ? kCoarse : 1) * Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.changed = true;
  }

  pixelsPerMm() {  // at the place that the view turns about
    const distance = this.camera.position.distanceTo(this.controls.target);
    return this.canvas.clientHeight / (2 * distance * Math.tan(THREE.Math.degToRad(this.camera.fov / 2)));
  }

  // Pixels from the top left corner of the picture, or null if it is behind.
  onScreen(place) {
    const p = place.clone().project(this.camera);
    if (p.z > 1) return null;
    return [(0.5 + 0.5 * p.x) * this.canvas.clientWidth, (0.5 - 0.5 * p.y) * this.canvas.clientHeight];
  }

  // Without a graphics processor a picture that changes all the time is made of fewer pixels, and of all when it rests.
  chooseSize() {
    if (!this.software || this.inHeadset) return;
    const rested = performance.now() - this.drawn > kRest;
    if (this.changed) this.drawn = performance.now();
    const coarse = this.changed ? !rested : Boolean(this.coarse) && !rested;
    if (coarse === Boolean(this.coarse)) return;
    this.coarse = coarse;
    this.resize();
  }

  draw(always = false) {
    this.chooseSize();
    if (!this.changed && !always) return false;
    this.changed = false;
    this.updateSection();
    const wipe = this.inHeadset ? 0 : this.wipe;
    this.surfaces.before.group.visible = wipe > 0;
    View.drawEyes(this, this.inHeadset ? 'off' : this.stereo, (left, width) => {
      const border = left + wipe * width;
      this.surfaces.before.uniforms.wipe.value.set(-1e9, border);
      this.surfaces.now.uniforms.wipe.value.set(wipe > 0 ? border : -1e9, 1e9);
    });
    ++this.frames;
    return true;
  }
};

// The switch and the scale of deviation colours.
View.offerDeviation = (facts, picture) => {
  const byId = (id) => document.getElementById(id);
  const context = byId('deviation-bar').getContext('2d'), {colours, limit} = facts.deviation;
  const width = context.canvas.width / colours.length;
  colours.forEach((c, i) => {
    context.fillStyle = `#${new THREE.Color(...c).convertLinearToSRGB().getHexString()}`;
    context.fillRect(i * width, 0, width + 1, context.canvas.height);
  });
  byId('deviation-limit').textContent = `−${limit} mm (cut too far) to ${limit} mm (left)`;
  byId('deviation-label').hidden = false;
  byId('deviation').addEventListener('change', (event) => picture.setDeviation(event.target.checked));
  picture.setDeviation(true);
};
