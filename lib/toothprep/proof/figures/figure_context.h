// What the experiments share while they run: options, progress, and how their files are written.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/proof/figures/figures.h"
#include "toothprep/proof/figures/outcome.h"

namespace toothprep::figures {

// Percent by which the torque's work may differ from the energy of what was removed, of level sets.
constexpr double kAuditAim = 1;

class FigureContext {
 public:
  FigureContext(const FigureOptions& options, int replays) : options_(options), replays_(replays) {}

  const FigureOptions& options() const { return options_; }

  // Runs the jobs in parallel, and reports each when it is done.
  struct Job {
    std::string what;
    std::function<void()> work;
    int replays = 1;
  };
  void run(const std::vector<Job>& jobs);

  // make_specimen(), made once for all that ask for the same; copies share its bricks.
  LayeredTooth specimen(const Experiment& experiment, const Run& run, double voxel);

  // path_of(). One that was kept is found at once, and only the first time: it takes much memory.
  std::vector<HandleSample> path(const Run& run, const Parameters& parameters);
  void keep_path(const Run& run, const Parameters& parameters);

  // Files of an experiment: FOLDER/NAME in the output; the relative path is returned.
  std::string write_trace(const Experiment& experiment, const std::string& name, const Run& run,
                          Outcome& outcome) const;  // whose rows are lent, and back afterwards
  std::string write_exact(const Experiment& experiment, const std::string& name,
                          const std::vector<HandleSample>& path, const Exact& exact) const;
  std::string write_series(const Experiment& experiment, const std::string& name,
                           const std::vector<std::string>& columns,
                           const std::vector<std::vector<double>>& values) const;
  // NAME.ply, and its surface for pictures of it.
  std::pair<std::string, Surface> write_surface(const Experiment& experiment,
                                                const std::string& name,
                                                const LayeredTooth& tooth) const;
  // NAME.ply and NAME.vdb; the latter's relative path, and the tooth for pictures of it.
  std::pair<std::string, Surface> write_layers(const Experiment& experiment,
                                               const std::string& name, LayeredTooth tooth) const;

 private:
  std::string place(const Experiment& experiment, const std::string& file) const;

  const FigureOptions& options_;
  int replays_, done_ = 0;
  std::mutex mutex_;
  // By whether it is a molar, size, enamel and voxel.
  std::map<std::array<double, 6>, LayeredTooth> specimens_;
  // By trajectory and time step.
  std::map<std::pair<std::string, double>, std::vector<HandleSample>> paths_;
};

// Replays every run of the experiment with this engine, in parallel; in the order of the runs.
std::vector<Outcome> replay_runs(const Experiment& experiment, EngineKind engine,
                                 FigureContext& context);

// The figures of a replay; those of a comparison too if `exact` is given.
RunReport report_of(const Run& run, const Outcome& outcome, double voxel, const Exact* exact);

// Three panels over time: F_x, F_y and T_z.
std::vector<Panel> force_panels(const std::vector<Curve>& files, const std::string& exact);

// The kinds of experiment. Each says how many replays it takes and runs them.
int replays_of(const Experiment& experiment, const FigureOptions& options);
FigureReport feed_figure(const Experiment& experiment, FigureContext& context);
FigureReport stall_figure(const Experiment& experiment, FigureContext& context);
FigureReport closed_loop_figure(const Experiment& experiment, FigureContext& context);
FigureReport preparation_figure(const Experiment& experiment, FigureContext& context);
FigureReport literal_figure(const Experiment& experiment, FigureContext& context);
FigureReport droop_figure(const Experiment& experiment, FigureContext& context);
FigureReport passes_figure(const Experiment& experiment, FigureContext& context);
FigureReport ablation_figure(const Experiment& experiment, FigureContext& context);
FigureReport feasibility_figure(const Experiment& experiment, FigureContext& context);
FigureReport laws_figure(const Experiment& experiment, FigureContext& context);
FigureReport rotor_figure(const Experiment& experiment, FigureContext& context);
FigureReport validation_figure(const Experiment& experiment, FigureContext& context);
FigureReport transparency_figure(const Experiment& experiment, FigureContext& context);

}  // namespace toothprep::figures
