// Two eyes: side by side, anaglyph (red left, cyan right), or a headset (WebXR) where the browser has one.
'use strict';

const kEyes = 1 / 30;     // of the distance to what is looked at, between the eyes
const kSideZoom = 0.65;
const kHeadset = 0.02;    // m per mm: a tooth as large as a head
const kInFront = new THREE.Vector3(0, 1.3, -0.8);  // m: where its middle is, from the floor below the viewer

// Draws the picture for one camera, or for two eyes; `area(left, width)` is called before each with the pixels that
// it takes.
View.drawEyes = (picture, kind, area) => {
  const {renderer, three, camera} = picture, gl = renderer.getContext();
  const size = renderer.getDrawingBufferSize(new THREE.Vector2());
  if (kind === 'off') {
    area(0, size.x);
    renderer.render(three, camera);
    return;
  }
  const eyes = picture.eyes = picture.eyes || new THREE.StereoCamera();
  const ratio = renderer.getPixelRatio(), half = kind === 'side' ? 0.5 : 1, colour = renderer.state.buffers.color;
  eyes.aspect = half;
  camera.focus = camera.position.distanceTo(picture.controls.target);
  eyes.eyeSep = kEyes * camera.focus;
  three.updateMatrixWorld();
  camera.zoom = kind === 'side' ? kSideZoom : 1;  // all of the tooth in half the width
  eyes.update(camera);
  camera.zoom = 1;
  renderer.autoClear = false;
  renderer.clear();
  [eyes.cameraL, eyes.cameraR].forEach((eye, i) => {
    const left = kind === 'side' ? i * size.x / 2 : 0;
    area(left, half * size.x);
    if (kind === 'side') {
      renderer.setScissorTest(true);
      renderer.setScissor(left / ratio, 0, half * size.x / ratio, size.y / ratio);
      renderer.setViewport(left / ratio, 0, half * size.x / ratio, size.y / ratio);
    } else {
      colour.setLocked(false);
      if (i > 0) renderer.clear(false, true, true);
      gl.colorMask(i === 0, i > 0, i > 0, true);
      colour.setLocked(true);
    }
    renderer.render(three, eye);
  });
  colour.setLocked(false);
  gl.colorMask(true, true, true, true);
  renderer.setScissorTest(false);
  renderer.setViewport(0, 0, size.x / ratio, size.y / ratio);
  renderer.autoClear = true;
};

// The rig that carries the camera puts the headset's space (m, y up) into the tooth's (mm): the tooth is before the
// eyes with the occlusal side up and the buccal side to the viewer, kHeadset as large.
View.enterHeadset = (picture, on) => {
  const {rig, axes, middle} = picture;
  picture.inHeadset = on;
  rig.quaternion.set(0, 0, 0, 1);
  rig.scale.setScalar(1);
  rig.position.set(0, 0, 0);
  if (on) {
    const x = axes.occlusal.clone().cross(axes.buccal);
    rig.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, axes.occlusal, axes.buccal));
    rig.scale.setScalar(1 / kHeadset);
    rig.position.copy(kInFront).divideScalar(-kHeadset).applyQuaternion(rig.quaternion).add(middle);
  } else {
    picture.three.traverse((part) => { part.frustumCulled = part !== picture.lag; });
    picture.resize();
  }
  picture.changed = true;
};

// Offers a headset if there is one; `step(time)` is called for each of its pictures, and must draw it.
View.offerHeadset = async (picture, place, step) => {
  if (!navigator.xr || !navigator.xr.isSessionSupported || !await navigator.xr.isSessionSupported('immersive-vr')) return;
  const {VRButton} = await import('./vr-button.js');
  const {renderer, three} = picture;
  await renderer.getContext().makeXRCompatible();
  place.append(Object.assign(VRButton.createButton(renderer), {id: 'headset'}));
  renderer.vr.enabled = true;
  renderer.setAnimationLoop((time) => {
    const on = renderer.vr.isPresenting();
    if (on !== picture.inHeadset) View.enterHeadset(picture, on);
    if (!on) return;
    // What three.js leaves out as beyond the sight is reckoned in one unit, and a rig with a scale has two.
    three.traverse((part) => { part.frustumCulled = false; });
    step(time);
  });
};

// A round mouth mirror that reflects the scene: dragged by the mouse (with shift: turned), or moved by a second device.
View.Mirror = class {
  constructor(picture) {
    this.picture = picture;
    const r = this.radius = 0.5 * picture.radius;
    this.group = new THREE.Group();
    this.glass = new THREE.Reflector(new THREE.CircleBufferGeometry(r, 48), {textureWidth: 1024, textureHeight: 1024, clipBias: 0.003, color: 0x8f9498});
    this.glass.getRenderTarget().stencilBuffer = true;  // for the face of a section
    const reflect = this.glass.onBeforeRender;
    this.glass.onBeforeRender = (...given) => {  // all of the tooth as it is now: the wipe is of the picture alone
      const {now, before} = picture.surfaces, wiped = now.uniforms.wipe.value.clone(), shown = before.group.visible;
      now.uniforms.wipe.value.set(-1e9, 1e9);
      before.group.visible = false;
      reflect(...given);
      now.uniforms.wipe.value.copy(wiped);
      before.group.visible = shown;
      ++this.reflections;
    };
    this.reflections = 0;
    const steel = new THREE.MeshPhongMaterial({color: 0xb9c3cc, specular: 0x555555, shininess: 40, side: THREE.DoubleSide});
    const back = new THREE.Mesh(new THREE.CylinderBufferGeometry(1.06 * r, 0.9 * r, 0.12 * r, 48).rotateX(Math.PI / 2).translate(0, 0, -0.08 * r), steel);
    const stem = new THREE.Mesh(new THREE.CylinderBufferGeometry(0.09 * r, 0.09 * r, 6 * r, 16).translate(0, 3.9 * r, 0).rotateX(-0.6), steel);
    this.group.add(this.glass, back, stem);
    picture.three.add(this.group);
    this.place();
    this.dragged = this.dragging(picture.canvas);
  }

  // Beside the tooth, so that its middle is seen in it from where the camera is.
  place() {
    const {middle, camera, radius} = this.picture;
    const axis = (n) => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, n);
    camera.updateMatrixWorld();
    this.group.position.copy(middle).addScaledVector(axis(0), -1.15 * radius).addScaledVector(axis(1), 0.1 * radius)
      .addScaledVector(axis(2), -0.7 * radius);
    const from = this.group.position, to = (p) => p.clone().sub(from).normalize();
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), to(middle).add(to(camera.position)).normalize());
    this.picture.changed = true;
  }

  remove() {
    this.picture.three.remove(this.group);
    this.glass.getRenderTarget().dispose();
    this.dragged();
    this.picture.changed = true;
  }

  // Moves as the second device does since it was seen first; its axes are taken for those of the tooth's frame.
  follow(position, quaternion) {
    if (!position.every(Number.isFinite)) return;
    const at = new THREE.Vector3(...position), turned = new THREE.Quaternion(...quaternion);
    if (!this.first)
      this.first = {at, turned: turned.clone().inverse(), position: this.group.position.clone(), quaternion: this.group.quaternion.clone()};
    this.group.position.copy(this.first.position).add(at).sub(this.first.at);
    this.group.quaternion.copy(turned).multiply(this.first.turned).multiply(this.first.quaternion);
    this.picture.changed = true;
  }

  dragging(canvas) {
    const {picture} = this, caster = new THREE.Raycaster(), plane = new THREE.Plane();
    let held = null;
    const aim = (event) => {
      const box = canvas.getBoundingClientRect();
      caster.setFromCamera({x: 2 * (event.clientX - box.left) / box.width - 1, y: 1 - 2 * (event.clientY - box.top) / box.height}, picture.camera);
    };
    const down = (event) => {
      aim(event);
      const [hit] = caster.intersectObject(this.group, true);
      if (!hit) return;
      plane.setFromNormalAndCoplanarPoint(picture.camera.getWorldDirection(new THREE.Vector3()), hit.point);
      held = {x: event.clientX, y: event.clientY, point: hit.point.clone(), turns: event.shiftKey || event.button === 2};
      event.stopImmediatePropagation();
      event.preventDefault();
    };
    const move = (event) => {
      if (!held) return;
      aim(event);
      const to = caster.ray.intersectPlane(plane, new THREE.Vector3());
      if (held.turns) {
        const axis = (n) => new THREE.Vector3().setFromMatrixColumn(picture.camera.matrixWorld, n);
        this.group.quaternion.premultiply(new THREE.Quaternion().setFromAxisAngle(axis(1), 0.01 * (event.clientX - held.x)))
          .premultiply(new THREE.Quaternion().setFromAxisAngle(axis(0), 0.01 * (event.clientY - held.y)));
      } else if (to) {
        this.group.position.add(to).sub(held.point);
        held.point.copy(to);
      }
      Object.assign(held, {x: event.clientX, y: event.clientY});
      picture.changed = true;
    };
    const up = () => { held = null; };
    canvas.addEventListener('mousedown', down, true);
    window.addEventListener('mousemove', move);
    window.addEventListener('mouseup', up);
    return () => {
      canvas.removeEventListener('mousedown', down, true);
      window.removeEventListener('mousemove', move);
      window.removeEventListener('mouseup', up);
    };
  }
};
