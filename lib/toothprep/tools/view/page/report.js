// The scene in a score's report: two surfaces of the file itself (report_scene.h).
'use strict';

(async () => {
  const section = document.getElementById('scene');
  const content = (id) => document.getElementById(id).textContent;
  const packed = async (id) => {
    const bytes = Uint8Array.from(atob(content(id)), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    return View.unpackMesh(await new Response(stream).arrayBuffer());
  };
  const make = (parent, tag, text, set = {}) => {
    const element = Object.assign(document.createElement(tag), set);
    element.append(text);
    parent.append(element);
    return element;
  };
  try {
    if (typeof DecompressionStream === 'undefined' || !document.createElement('canvas').getContext('webgl2')) return;
    const facts = JSON.parse(content('scene-facts'));
    make(section, 'h2', 'The preparation, to be turned');
    const tools = make(section, 'p', '');
    const canvas = make(section, 'canvas', '', {id: 'picture'});
    canvas.style.cssText = 'width:100%;height:min(70vh,32rem);display:block;touch-action:none;border-radius:4px';
    section.hidden = false;
    const picture = new View.Picture(canvas, facts);
    for (const name of ['oblique', 'occlusal', 'buccal', 'lingual', 'mesial', 'distal']) {
      make(tools, 'button', name, {type: 'button', id: `view-${name}`}).addEventListener('click', () => picture.look(name));
      tools.append(' ');
    }
    const slider = (text, set, use) => {
      const label = make(tools, 'label', `${text} `);
      label.style.cssText = 'margin-left:1em;white-space:nowrap';
      make(label, 'input', '', {type: 'range', ...set}).addEventListener('input', (event) => use(Number(event.target.value)));
      tools.append(' ');
      return label;
    };
    slider('before', {id: 'wipe', min: 0, max: 1, step: 0.005, value: 0}, (share) => picture.setWipe(share)).append(' after');
    slider('cut open', {id: 'cut', min: -1, max: 1, step: 0.01, value: 1}, (offset) => {
      Object.assign(picture.section, {kind: offset < 1 ? 'buccal' : 'off', offset, follows: false});
      picture.changed = true;
    });
    if (facts.deviation) {
      const label = make(tools, 'label', '', {id: 'deviation-label'});
      make(label, 'input', '', {type: 'checkbox', id: 'deviation', checked: true});
      label.append(' deviation from the target ');
      make(label, 'canvas', '', {id: 'deviation-bar', width: 120, height: 12});
      make(label, 'span', '', {id: 'deviation-limit'});
      View.offerDeviation(facts, picture);
    }
    make(section, 'p', 'Drag turns, the right button moves, the wheel zooms. With three.js (MIT licence).', {className: 'muted small-text'});
    new ResizeObserver(() => picture.resize()).observe(canvas);
    picture.surfaces.now.update(await packed('scene-after'));
    picture.surfaces.before.update(await packed('scene-before'));
    const draw = () => { requestAnimationFrame(draw); picture.draw(); };
    picture.changed = true;
    draw();
    window.toothprep = {state: () => ({
      ready: picture.frames > 0, triangles: picture.surfaces.now.triangles, triangles_before: picture.surfaces.before.triangles,
      pictures: picture.frames, wipe: picture.wipe, deviation: picture.surfaces.now.uniforms.deviates.value === 1,
    })};
  } catch (error) {  // the pictures below show the same
    section.hidden = true;
    console.warn(error);
  }
})();
