// A stand-in for a headset: as much of WebXR (https://www.w3.org/TR/webxr/) as a page needs that draws for two eyes.
// Its pictures go onto the page's canvas, the left eye's into the left half. The head is 1.6 m above the floor and
// looks straight ahead (-z), slightly down to what is 1.3 m high and 0.8 m away.
'use strict';

window.headset = {sessions: [], pictures: 0};

(() => {
  const compatible = new WeakSet();
  WebGL2RenderingContext.prototype.makeXRCompatible = function () {
    compatible.add(this);
    return Promise.resolve();
  };

  window.XRWebGLLayer = class {
    constructor(session, gl) {
      if (!compatible.has(gl)) throw new DOMException('the context is not compatible', 'InvalidStateError');
      this.framebuffer = null;
      this.canvas = gl.canvas;
    }
    getViewport(view) {
      const half = this.canvas.width / 2;
      return {x: view.eye === 'left' ? 0 : half, y: 0, width: half, height: this.canvas.height};
    }
  };

  const kNear = 0.1, kFar = 1000, kEyes = 0.064, kDown = Math.atan2(0.3, 0.8);
  const viewOf = (eye) => {
    const canvas = document.getElementById('picture'), f = 1 / Math.tan(0.35), aspect = canvas.width / 2 / canvas.height;
    const projectionMatrix = new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, -(kFar + kNear) / (kFar - kNear), -1,
      0, 0, -2 * kFar * kNear / (kFar - kNear), 0]);
    const c = Math.cos(kDown), s = Math.sin(kDown), x = (eye === 'left' ? -0.5 : 0.5) * kEyes, y = 1.6;
    // World to eye: moved by (-x, -y, 0), then turned about x by the angle down.
    const inverse = new Float32Array([1, 0, 0, 0, 0, c, s, 0, 0, -s, c, 0, -x, -y * c, -y * s, 1]);
    return {eye, projectionMatrix, transform: {inverse: {matrix: inverse}}};
  };

  class Session extends EventTarget {
    constructor() {
      super();
      this.inputSources = [];
      this.renderState = {};
    }
    updateRenderState(state) { Object.assign(this.renderState, state); }
    requestReferenceSpace(kind) { return Promise.resolve({kind}); }
    requestAnimationFrame(callback) {
      return window.requestAnimationFrame((time) => {
        if (this.ended) return;
        ++window.headset.pictures;
        callback(time, {getViewerPose: () => ({views: [viewOf('left'), viewOf('right')]}), getPose: () => null});
      });
    }
    cancelAnimationFrame(handle) { window.cancelAnimationFrame(handle); }
    end() {
      this.ended = true;
      this.dispatchEvent(new Event('end'));
      return Promise.resolve();
    }
  }

  Object.defineProperty(navigator, 'xr', {value: {
    isSessionSupported: (kind) => Promise.resolve(kind === 'immersive-vr'),
    requestSession: (kind) => {
      const session = new Session();
      window.headset.sessions.push(kind);
      return Promise.resolve(session);
    },
  }});
})();
