// toothprep render: a tooth or mesh as a picture, without a display.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "command.h"
#include "drawn.h"
#include "progress_line.h"
#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/mesh/triangle_tree.h"
#include "toothprep/tools/render/image.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/render/renderer.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string input, output;
  std::string view, size = "1200x900", cut, colour = "tissue", occlusal, mesial;
  std::string reference, before, ghost;
  std::vector<double> centre;
  int samples = 4, turntable = 0;
  double range = 0.3, zoom = 1;
  bool no_scale = false, force = false, strict = false;
};

// Signed distances of the part's vertices to the reference, or what the file itself says of them.
void find_deviation(const Options& o, RenderPart& part) {
  if (!o.reference.empty()) {
    const Drawn reference = read_drawn(o.reference, o.strict);
    const TriangleTree tree(reference.part.mesh);
    part.deviation.resize(part.mesh.vertices.size());
    tbb::parallel_for(std::size_t{0}, part.deviation.size(), [&](std::size_t v) {
      part.deviation[v] =
          static_cast<float>(tree.signed_distance(part.mesh.vertices[v].cast<double>()));
    });
    return;
  }
  for (const char* name : {"deviation", "quality"})
    if (auto values = vertex_property(o.input, part.mesh, name)) {
      part.deviation = std::move(*values);
      return;
    }
  if (o.colour == "deviation")
    throw InputError(o.input, "--color deviation", "there is nothing to deviate from",
                     "give --reference, or a .ply with the vertex property 'deviation'");
}

Fit fit_of(const Options& o) {
  Fit fit;
  int read = 0;
  if (std::sscanf(o.size.c_str(), "%dx%d%n", &fit.width, &fit.height, &read) != 2 ||
      read != static_cast<int>(o.size.size()))
    throw Error("--size '" + o.size + "': give WIDTHxHEIGHT in pixels");
  fit.zoom = o.zoom;
  if (o.centre.size() == 3) fit.centre = Vec3(o.centre[0], o.centre[1], o.centre[2]);
  return fit;
}

struct Drawing {
  const Options& o;
  ToothAxes axes;
  View view;
  Fit fit;
  RenderOptions options;
  std::function<void(const std::string&, double)> progress;  // may be empty

  Picture finished(const Image& image, bool scale) const {
    Picture picture = picture_of(image);
    if (scale && !o.no_scale) draw_scale_bar(picture, image.camera.mm_per_pixel);
    if (!o.no_scale) draw_triad(picture, image.camera, axes);
    return picture;
  }

  void turntable(const Renderer& renderer, const std::string& folder) const {
    const auto angle = [&](int n) { return 2 * units::kPi * n / o.turntable; };
    Fit all = fit;
    if (!all.centre) all.centre = renderer.middle();
    double widest = 0;  // the same scale in all frames
    for (int n = 0; n < o.turntable; ++n) {
      const View turn = turned(view, axes.occlusal, angle(n));
      widest = std::max(widest, o.zoom * fit_camera(turn, renderer.meshes(), all).mm_per_pixel);
    }
    all.mm_per_pixel = widest;
    for (int n = 0; n < o.turntable; ++n) {
      const View turn = turned(view, axes.occlusal, angle(n));
      RenderOptions frame = options;
      if (progress)
        frame.progress = [&](double done) {
          progress(fmt::format("frame {} of {}", n + 1, o.turntable), (n + done) / o.turntable);
        };
      const Image image = renderer.render(fit_camera(turn, renderer.meshes(), all), frame);
      Picture picture = finished(image, true);
      if (o.colour == "deviation" && !o.no_scale) draw_colour_bar(picture, o.range);
      write_png(picture, fmt::format("{}/frame_{:03}.png", folder, n));
    }
  }

  Picture before_after(const Renderer& before, const Renderer& after) const {
    std::vector<const TriangleMesh*> meshes = before.meshes();
    for (const TriangleMesh* mesh : after.meshes()) meshes.push_back(mesh);
    Fit half = fit;
    half.width /= 2;
    const Camera camera = fit_camera(view, meshes, half);
    return side_by_side({finished(before.render(camera, options), true),
                         finished(after.render(camera, options), false)});
  }
};

void check(const Options& o) {
  if (o.turntable > 0) {
    if (std::filesystem::path(o.output).has_extension())
      throw InputError(o.output, "--turntable", "the frames go into a folder",
                       "give a name without extension");
    if (!o.before.empty()) throw Error("--turntable and --before don't go together");
    return;
  }
  if (has_extension(o.output, ".exr") && !o.before.empty())
    throw InputError(o.output, "--before", "two teeth side by side are a .png");
}

// The tooth's, those given before those of the file.
ToothAxes axes_of(const Options& o, const LayeredTooth* tooth) {
  ToothFrame frame;
  if (tooth) frame = recorded_frame(tooth->provenance);
  if (!o.occlusal.empty())
    frame.occlusal = recorded_frame({{"axis_occlusal", o.occlusal}}).occlusal;
  if (!o.mesial.empty()) frame.mesial = recorded_frame({{"axis_mesial", o.mesial}}).mesial;
  return axes_of_frame(frame);
}

// A side by its name is a side of the tooth; where the tooth's aren't known the picture shows
// another.
void say_what_is_made_up(const Options& o, const ToothAxes& axes, const Common& common) {
  for (const std::string& name : {o.view, o.cut}) {
    if (std::find(std::begin(kViewNames) + 1, std::end(kViewNames), name) == std::end(kViewNames))
      continue;
    const bool end_on = name == "occlusal" || name == "apical";
    if (!axes.occlusal_known || (!end_on && !axes.mesial_known && !axes.buccal_known))
      say(common, "note: where the tooth's " + std::string(end_on ? "occlusal" : name) +
                      " side is isn't known, so +z is taken as occlusal and -y as mesial where "
                      "nothing better is; `toothprep orient` finds or sets it");
  }
}

void run(const Options& o, const Common& common) {
  check(o);
  const Fit fit = fit_of(o);
  Outputs outputs(o.force);
  outputs.reads({o.input, o.reference, o.before, o.ghost});
  const std::string output =
      o.turntable > 0 ? outputs.folder(o.output) : outputs.file(o.output, {".png", ".exr"});
  outputs.begin();

  Drawn drawn = read_drawn(o.input, o.strict);
  find_deviation(o, drawn.part);
  drawn.part.colour = o.colour == "tissue"      ? ColourBy::kTissue
                      : o.colour == "deviation" ? ColourBy::kDeviation
                                                : ColourBy::kPlain;
  const ToothAxes axes = axes_of(o, drawn.tooth.get());
  say_what_is_made_up(o, axes, common);

  Drawn ghost;
  std::vector<RenderPart> parts;
  parts.push_back(std::move(drawn.part));
  if (!o.ghost.empty()) {
    ghost = read_drawn(o.ghost, o.strict);
    ghost.part.ghost = true;
    parts.push_back(std::move(ghost.part));
  }
  const Renderer renderer(std::move(parts));

  ProgressLine progress(common);
  Drawing drawing{o, axes, {}, fit, {}, progress.report()};
  if (drawing.progress && o.turntable == 0)
    drawing.options.progress = [&](double done) { drawing.progress("drawing", done); };
  drawing.options.samples = o.samples;
  drawing.options.range = o.range;
  if (!o.cut.empty()) drawing.options.cut = cut_of(o.cut, axes, renderer.middle());
  if (!o.view.empty() || o.cut.empty()) {
    drawing.view = view_of(o.view.empty() ? "oblique" : o.view, axes);
  } else {
    drawing.view = view_at(*drawing.options.cut, axes, o.cut);
  }

  if (o.turntable > 0) {
    drawing.turntable(renderer, output);
  } else if (!o.before.empty()) {
    Drawn before = read_drawn(o.before, o.strict);
    std::vector<RenderPart> alone;
    alone.push_back(std::move(before.part));
    Picture picture = drawing.before_after(Renderer(std::move(alone)), renderer);
    if (o.colour == "deviation" && !o.no_scale) draw_colour_bar(picture, o.range);
    write_png(picture, output);
  } else {
    const Image image =
        renderer.render(fit_camera(drawing.view, renderer.meshes(), fit), drawing.options);
    if (has_extension(o.output, ".exr")) {
      write_exr(image, output, {{"software", std::string("toothprep ") + kVersion}});
    } else {
      Picture picture = drawing.finished(image, true);
      if (o.colour == "deviation" && !o.no_scale) draw_colour_bar(picture, o.range);
      write_png(picture, output);
    }
  }
  outputs.publish();
  say(common, o.output + ": " + o.size + " pixels, " + drawing.view.name +
                  (o.turntable > 0 ? ", " + std::to_string(o.turntable) + " frames" : ""));
}

}  // namespace

void add_render(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("render", "Picture of a tooth or mesh as PNG or OpenEXR");
  const auto o = std::make_shared<Options>();
  sub->add_option("input", o->input, "Tooth (.vdb) or mesh (.ply, .stl, .obj, .off)")->required();
  sub->add_option("-o,--output", o->output,
                  ".png; .exr with depth, normal, tissue and deviation; a folder for --turntable")
      ->required();
  sub->add_option("--view", o->view,
                  "oblique, occlusal, buccal, lingual, mesial, distal, apical, or the direction "
                  "X,Y,Z to look from; default: oblique, or straight at the --cut");
  sub->add_option("--size", o->size, "Pixels, WIDTHxHEIGHT")->capture_default_str();
  sub->add_option("--samples", o->samples, "Anti-aliasing: samples per pixel, each way")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  sub->add_option("--cut", o->cut,
                  "Remove what is in front of a plane: a side (mesial, buccal, ...) through the "
                  "middle, or X,Y,Z,NX,NY,NZ (mm, W)");
  sub->add_option("--color", o->colour, "What the colours show")
      ->check(CLI::IsMember({"tissue", "deviation", "plain"}))
      ->capture_default_str();
  sub->add_option("--reference", o->reference,
                  "Tooth or closed mesh from which the deviation is measured: red outside of it, "
                  "blue inside");
  sub->add_option("--range-mm", o->range, "Deviation at which the colours end")
      ->capture_default_str();
  sub->add_option("--before", o->before, "Tooth or mesh to draw at the left, to the same scale");
  sub->add_option("--ghost", o->ghost, "Tooth or mesh to draw as a glass around it");
  sub->add_option("--turntable", o->turntable, "Frames of a full turn about the occlusal axis")
      ->check(CLI::Range(1, 999));
  sub->add_option("--zoom", o->zoom, "Magnification")->capture_default_str();
  sub->add_option("--centre", o->centre, "Place in the middle of the picture, X,Y,Z (mm, W)")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--occlusal", o->occlusal,
                  "Occlusal direction X,Y,Z; default: the file's, or +z");
  sub->add_option("--mesial", o->mesial, "Mesial direction X,Y,Z; default: the file's, or -y");
  sub->add_flag("--no-scale", o->no_scale,
                "Without scale bar, colour bar and the tooth's directions");
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "Lengths across the picture are true (parallel projection).\n"
      "Example: toothprep render prepared.vdb -o cut.png --cut mesial --before molar.vdb");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
