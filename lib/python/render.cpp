// Pictures of teeth.
#include <fmt/format.h>

#include "bindings.h"
#include "long_work.h"
#include "options.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/renderer.h"
#include "toothprep/version.h"

namespace toothprep::python {
namespace {

struct Drawing {
  Image image;
  Picture picture;
};

struct Wanted {
  std::optional<std::string> view, cut;
  Fit fit;
  RenderOptions options;
  bool scale_bar = true;
};

Wanted wanted_of(const py::dict& o) {
  Wanted w;
  w.view = taken<std::optional<std::string>>(o, "view");
  w.cut = taken<std::optional<std::string>>(o, "cut");
  const auto size = taken<std::array<int, 2>>(o, "size");
  w.fit.width = size[0];
  w.fit.height = size[1];
  w.fit.zoom = taken<double>(o, "zoom");
  w.fit.centre = vector_taken(o, "centre_mm");
  w.options.samples = taken<int>(o, "samples");
  w.scale_bar = taken<bool>(o, "scale_bar");
  return w;
}

Drawing draw(const LayeredTooth& tooth, Wanted w, Progress& progress) {
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  const ToothAxes axes = tooth_axes(tooth.provenance);
  View view = view_of(w.view.value_or("oblique"), axes);
  if (w.cut) {
    w.options.cut = cut_of(*w.cut, axes, renderer.middle());
    if (!w.view) view = view_at(*w.options.cut, axes, *w.cut);
  }
  w.options.progress = [&](double done) { progress.report("drawing", 0.9 * done); };
  Drawing drawing;
  drawing.image = renderer.render(fit_camera(view, renderer.meshes(), w.fit), w.options);
  drawing.picture = picture_of(drawing.image);
  if (w.scale_bar) {
    draw_scale_bar(drawing.picture, drawing.image.camera.mm_per_pixel);
    draw_triad(drawing.picture, drawing.image.camera, axes);
  }
  return drawing;
}

void write(const Drawing& drawing, const std::string& path, bool overwrite) {
  Outputs outputs(overwrite);
  const std::string file = outputs.file(path, {".png", ".exr"});
  outputs.begin();
  if (file.ends_with(".exr"))
    write_exr(drawing.image, file, {{"software", std::string("toothprep ") + kVersion}});
  else
    write_png(drawing.picture, file);
  outputs.publish();
}

py::dict arrays_of(const Drawing& drawing) {
  const Image& image = drawing.image;
  const py::ssize_t h = image.height(), w = image.width();
  const Camera& c = image.camera;
  const auto vector = [](const Vec3& v) {
    return array_from(std::vector<double>{v.x(), v.y(), v.z()}, {3});
  };
  py::dict d;
  d["image"] = array_from(drawing.picture.rgb, {h, w, 3});
  d["depth_mm"] = array_from(image.depth, {h, w});
  d["normal"] = array_from(image.normal, {h, w, 3});
  d["tissue"] =
      array_from(std::vector<std::uint8_t>(image.tissue.begin(), image.tissue.end()), {h, w});
  d["view"] = c.view;
  d["mm_per_pixel"] = c.mm_per_pixel;
  d["camera_origin_mm"] = vector(c.origin);
  d["camera_right"] = vector(c.right);
  d["camera_up"] = vector(c.up);
  d["camera_forward"] = vector(c.forward);
  return d;
}

py::dict rendered(const std::shared_ptr<Tooth>& tooth, const std::string& output, bool overwrite,
                  const py::dict& options, const py::object& progress) {
  const Wanted wanted = wanted_of(options);
  Drawing drawing;
  run_long(progress, [&](Progress& p) {
    drawing = draw(tooth->layers, wanted, p);
    p.report("writing", 0.9);
    if (!output.empty()) write(drawing, output, overwrite);
    p.report("done", 1.0);
  });
  return arrays_of(drawing);
}

}  // namespace

void bind_render(py::module_& m) { m.def("render", &rendered, "Arrays of a picture."); }

}  // namespace toothprep::python
