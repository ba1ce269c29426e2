// toothprep figures: the paper's experiments, run and checked.
#include "toothprep/proof/figures/figures.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <utility>

#include "command.h"
#include "toothprep/build_info.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/renderer.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string output, experiments, engine = "both", params, preset = "paper";
  std::vector<std::string> only;
  double voxel = 0.1;
  bool force = false, no_plots = false, list = false, json = false, strict = false;
};

constexpr int kPixels = 700;  // width and height of a picture of one surface

// Draws the pictures of a figure, of which several show the same surfaces: each is made ready once
// for those that follow each other, and what was drawn from the same place at the same scale is kept.
class Pictures {
 public:
  Pictures(const figures::FigureReport& figure, std::string folder)
      : figure_(figure), folder_(std::move(folder)) {}

  // The surfaces of a picture from the same place at the same scale, side by side.
  void draw(const figures::Picture& picture) {
    std::vector<std::string> files;
    for (const std::string& file : {picture.compare, picture.mesh})
      if (!file.empty()) files.push_back(file);
    std::erase_if(ready_, [&](const auto& known) {
      return std::find(files.begin(), files.end(), known.first) == files.end();
    });
    std::vector<const TriangleMesh*> meshes;
    for (const std::string& file : files)
      for (const TriangleMesh* mesh : renderer(file).meshes()) meshes.push_back(mesh);
    const ToothAxes axes = tooth_axes({{"axis_occlusal", picture.occlusal}});
    Fit fit;
    fit.width = fit.height = kPixels;
    const Camera camera = fit_camera(view_of(picture.view, axes), meshes, fit);
    std::vector<toothprep::Picture> drawn;
    drawn.reserve(files.size());
    for (const std::string& file : files) drawn.push_back(drawing(file, camera));
    draw_scale_bar(drawn.front(), camera.mm_per_pixel);
    write_png(side_by_side(drawn), folder_ + "/" + picture.file);
  }

 private:
  struct Drawing {
    Camera camera;
    toothprep::Picture picture;
  };

  const Renderer& renderer(const std::string& file) {
    const auto known = ready_.find(file);
    if (known != ready_.end()) return known->second;
    const figures::Surface& surface = figure_.surfaces.at(file);
    std::vector<RenderPart> parts(1);
    parts.front().mesh = surface.mesh;
    if (surface.tooth) parts.front().tooth = &*surface.tooth;
    return ready_.emplace(file, Renderer(std::move(parts))).first->second;
  }

  static bool same(const Camera& a, const Camera& b) {
    return a.origin == b.origin && a.right == b.right && a.up == b.up && a.forward == b.forward &&
           a.mm_per_pixel == b.mm_per_pixel && a.width == b.width && a.height == b.height;
  }

  toothprep::Picture drawing(const std::string& file, const Camera& camera) {
    std::vector<Drawing>& known = drawings_[file];
    for (const Drawing& d : known)
      if (same(d.camera, camera)) return d.picture;
    RenderOptions options;
    options.samples = 2;
    options.ambient_rays = 32;
    known.push_back({camera, picture_of(renderer(file).render(camera, options))});
    return known.back().picture;
  }

  const figures::FigureReport& figure_;
  std::string folder_;
  std::map<std::string, Renderer> ready_;                 // by file
  std::map<std::string, std::vector<Drawing>> drawings_;  // by file
};

void run(const Options& o, const Common& common) {
  const std::string folder = o.experiments.empty() ? data_folder() + "/figures" : o.experiments;
  if (o.list) {
    for (const std::string& path : figures::find_experiments(folder, o.only)) {
      const figures::Experiment e = figures::read_experiment(path);
      std::printf("%-20s %s\n", e.name.c_str(), e.title.c_str());
    }
    return;
  }
  if (o.output.empty()) throw CLI::RequiredError("--output");
  Outputs outputs(o.force);
  outputs.reads({folder, o.params, data_folder()});
  const std::string output = outputs.folder(o.output);
  outputs.begin();
  const std::string script = "plot-figures";
  if (!o.no_plots && !run_script(script, {"--check"}))
    throw Error(script +
                " cannot run; install python3-numpy, python3-h5py and python3-matplotlib, or give "
                "--no-plots");

  figures::FigureOptions options;
  options.experiments = figures::find_experiments(folder, o.only);
  options.voxel = o.voxel;
  options.base =
      o.params.empty() ? preset_parameters(o.preset) : read_parameters(o.params, o.preset);
  if (o.engine == "levelset") options.engines = {EngineKind::kLevelset};
  if (o.engine == "voxel") options.engines = {EngineKind::kVoxel};
  options.bur_library = data_folder() + "/burs";
  options.version = kVersion;
  options.build = build_text();
  options.output = output;
  const bool terminal = !common.quiet && isatty(2);
  options.progress = [&](int done, int all, const std::string& what) {
    if (terminal)
      std::fprintf(stderr, "\rreplays %d of %d: %-40s", done, all, what.c_str());
    else
      say(common, "replays " + std::to_string(done) + " of " + std::to_string(all) + ": " + what);
  };
  const std::vector<figures::FigureReport> reports = run_figures(options);
  if (terminal) std::fprintf(stderr, "\r%-60s\r", "");
  if (!o.no_plots) {
    say(common, "drawing");
    std::vector<std::string> arguments = {output};
    if (common.quiet) arguments.push_back("--quiet");
    if (!run_script(script, arguments)) throw Error(script + " failed");
    for (const figures::FigureReport& f : reports) {
      Pictures pictures(f, output);
      for (const figures::Picture& picture : f.pictures) pictures.draw(picture);
    }
  }
  std::ostringstream table;
  if (o.json) table << std::ifstream(output + "/figures.json").rdbuf();
  outputs.publish();
  std::cout << table.str();

  std::size_t claims = 0, failing = 0, findings = 0;
  for (const figures::FigureReport& f : reports) {
    for (const figures::RunReport& r : f.runs)
      for (const std::string& finding : r.findings) {
        ++findings;
        warn(f.name + " (" + r.run + ", " + r.engine + "): " + finding);
      }
    for (const figures::Claim& c : f.claims) {
      ++claims;
      if (c.holds) continue;
      ++failing;
      warn(f.name + (c.engine.empty() ? "" : " (" + c.engine + ")") + ": " + c.claim + ": " +
           fmt::format("{}: expected {:.4g}, measured {:.4g}{}", c.quantity, c.expected, c.measured,
                       c.unit == "1" ? std::string() : " " + c.unit));
    }
  }
  std::size_t compared = 0, inside = 0, trends = 0, agreeing = 0;
  for (const figures::FigureReport& f : reports) {
    compared += f.comparisons.size();
    for (const figures::Comparison& c : f.comparisons) inside += c.verdict == "inside";
    for (const figures::Trend& t : f.trends) {
      trends += t.predicted != "no prediction";
      agreeing += t.agrees;
    }
  }
  if (compared > 0)
    say(common,
        fmt::format("of {} predictions of published measurements {} are inside the measured "
                    "band, of {} trends {} agree: findings about the model, not faults",
                    compared, inside, trends, agreeing));
  say(common, std::to_string(claims - failing) + " of " + std::to_string(claims) +
                  " claims hold; see " + o.output + "/figures.md");
  if (o.strict && failing + findings > 0)
    throw Error(o.output + ": " + std::to_string(failing) + " claims do not hold, " +
                std::to_string(findings) + " runs can't be right (--strict)");
}

}  // namespace

void add_figures(CLI::App& app, const Common& common) {
  auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "figures",
      "Runs the paper's experiments (figures 9 to 16): traces, plots, meshes, and a table of what\n"
      "should come out beside what did");
  sub->add_option("-o,--output", o->output, "Folder to make, required");
  sub->add_option("--only", o->only, "Some of them: numbers or names, e.g. 9,10,handpiece")
      ->delimiter(',');
  sub->add_option("--engine", o->engine, "levelset, voxel, or both side by side")
      ->check(CLI::IsMember({"levelset", "voxel", "both"}))
      ->capture_default_str();
  sub->add_option("--voxel-mm", o->voxel,
                  "Voxel size; feed experiments also run at twice and at half of it")
      ->check(CLI::Range(0.02, 0.3))
      ->capture_default_str();
  sub->add_option("--params", o->params, "Parameter file (.toml) under the experiments' own");
  sub->add_option("--preset", o->preset, "paper, physical or literature, under the parameter file")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kPresets), std::end(kPresets))))
      ->capture_default_str();
  sub->add_option("--experiments", o->experiments,
                  "Folder of experiments (default: data/figures; copy one there and change it)");
  sub->add_flag("--no-plots", o->no_plots, "Only numbers, traces and meshes");
  sub->add_flag("--json", o->json, "Also print figures.json");
  sub->add_flag("--strict", o->strict,
                "Exit 1 if a claim does not hold or a run can't be right; the folder is written");
  sub->add_flag("--list", o->list, "Lists the experiments");
  sub->add_flag("--force", o->force, "Replace an existing folder");
  sub->footer("Example: toothprep figures --only 9,13 -o figures");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
