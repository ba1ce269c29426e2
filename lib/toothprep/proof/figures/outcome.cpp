#include "toothprep/proof/figures/outcome.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/tools/device/high_pass_rms.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep::figures {
namespace {

constexpr double kSettled = 2e-3;  // a plateau's force is within this share of its last value
constexpr double kSlow = 2;        // Hz; the way of a voxel takes 0.2 s
constexpr std::size_t kLeastPlateau = 500;  // rows

// The handle between its samples: the cubic through them, which is exact for steady and for
// steadily accelerated motion.
reference::Handle handle_of(const std::vector<HandleSample>& path) {
  return [&path](double time) {
    const double h = path[1].time - path[0].time;
    const double s = std::clamp((time - path.front().time) / h, 0.0,
                                static_cast<double>(path.size()) - 1 - 1e-9);
    const auto i = static_cast<std::size_t>(s);
    const double x = s - static_cast<double>(i);
    const auto at = [&](std::size_t n) { return path[std::min(n, path.size() - 1)].pose.position; };
    const Vec3 p0 = at(i), p1 = at(i + 1);
    const Vec3 m0 = i == 0 ? Vec3(p1 - p0) : Vec3((p1 - at(i - 1)) / 2);
    const Vec3 m1 = i + 2 >= path.size() ? Vec3(p1 - p0) : Vec3((at(i + 2) - p0) / 2);
    const double x2 = x * x, x3 = x2 * x;
    reference::HandleMotion motion;
    motion.position = (2 * x3 - 3 * x2 + 1) * p0 + (x3 - 2 * x2 + x) * m0 +
                      (-2 * x3 + 3 * x2) * p1 + (x3 - x2) * m1;
    motion.velocity =
        ((6 * x2 - 6 * x) * (p0 - p1) + (3 * x2 - 4 * x + 1) * m0 + (3 * x2 - 2 * x) * m1) / h;
    return motion;
  };
}

double total(const PerTissue<double>& area) { return area[0] + area[1] + area[2] + area[3]; }

// The force that errors are measured against, and the torque.
struct Scale {
  double force = 0, torque = 0;
};
Scale scale_of(const Exact& exact) {
  Scale s;
  for (const Stretch& stretch : plateaus(exact)) {
    s.force = std::max(s.force, exact.force[stretch.last].norm());
    s.torque = std::max(s.torque, exact.torque[stretch.last]);
  }
  if (s.force > 0) return s;
  for (std::size_t i = 0; i < exact.force.size(); ++i) {
    s.force = std::max(s.force, exact.force[i].norm());
    s.torque = std::max(s.torque, exact.torque[i]);
  }
  return s;
}

}  // namespace

LayeredTooth make_specimen(const Experiment& experiment, const Run& run, double voxel) {
  if (experiment.molar) return make_molar({voxel});
  BlockOptions options = run.block;
  options.voxel = voxel;
  return make_block(options);
}

std::vector<HandleSample> path_of(const Run& run, const Parameters& parameters) {
  return resample(read_script(run.trajectory), parameters.time_step, false, run.trajectory);
}

Outcome run_on(const Run& run, const Parameters& parameters, const std::vector<HandleSample>& path,
               LayeredTooth tooth, const std::string& bur_library) {
  const Bur bur = make_bur(run.bur, bur_library);
  Outcome outcome;
  outcome.parameters = parameters;
  outcome.tooth_sha256 = tooth_sha256(tooth);
  LevelSet cut;
  {
    Workpiece workpiece(tooth);
    outcome.replay = replay(bur, workpiece, parameters, run.drive, path);
    cut = workpiece.cut();
  }
  apply_cut(tooth, cut);
  outcome.prepared = std::move(tooth);
  return outcome;
}

Exact exact_answer(const Run& run, const Parameters& parameters,
                   const std::vector<HandleSample>& path, const std::string& bur_library) {
  const Bur bur = make_bur(run.bur, bur_library);
  const reference::Scene scene =
      reference::make_scene(bur, {run.block.size, run.block.enamel}, parameters);
  Exact exact;
  exact.force.assign(path.size(), Vec3::Zero());
  exact.torque.assign(path.size(), 0);
  exact.area.assign(path.size(), PerTissue<double>{});
  if (run.drive == Drive::kDirect) {
    std::vector<reference::PathRow> rows(path.size());
    for (std::size_t i = 0; i < path.size(); ++i) {
      rows[i].time = path[i].time;
      rows[i].bur = path[i].pose;
      if (i > 0)
        rows[i].velocity =
            (path[i].pose.position - path[i - 1].pose.position) / parameters.time_step;
    }
    const std::vector<reference::Load> loads = load_along(scene, rows);
    for (std::size_t i = 0; i < loads.size(); ++i) {
      exact.force[i] = loads[i].force;
      exact.torque[i] = loads[i].torque;
      exact.area[i] = loads[i].area;
    }
    return exact;
  }
  reference::CoupledFeed feed;
  feed.handle = handle_of(path);
  feed.orientation = path.front().pose.orientation;
  feed.stiffness = parameters.coupling.stiffness;
  feed.damping = parameters.coupling.damping;
  feed.stall_torque = parameters.handpiece.stall_torque;
  std::vector<double> times;
  times.reserve(path.size());
  for (const HandleSample& s : path) times.push_back(s.time);
  const reference::CoupledResult solved = coupled_feed(scene, feed, times);
  for (std::size_t i = 0; i < solved.rows.size(); ++i) {
    exact.force[i] = solved.rows[i].force;
    exact.torque[i] = solved.rows[i].torque;
    exact.area[i] = solved.rows[i].area;
  }
  exact.stall = solved.stall;
  return exact;
}

std::vector<Exact> exact_answers(const std::vector<ExactTask>& tasks,
                                 const std::string& bur_library) {
  const auto same = [](const ExactTask& a, const ExactTask& b) {
    const auto text = [](Parameters p) {
      p.engine = EngineKind::kLevelset;
      p.trailing_elements = false;
      p.element_size = 0;
      return to_toml(p);
    };
    return a.run.bur == b.run.bur && a.run.drive == b.run.drive &&
           a.run.trajectory == b.run.trajectory && a.run.block.size == b.run.block.size &&
           a.run.block.enamel == b.run.block.enamel && a.path.size() == b.path.size() &&
           text(a.parameters) == text(b.parameters);
  };
  std::vector<std::size_t> first(tasks.size());
  for (std::size_t i = 0; i < tasks.size(); ++i)
    while (first[i] < i && !same(tasks[first[i]], tasks[i])) ++first[i];
  std::vector<Exact> answers(tasks.size());
  tbb::parallel_for(std::size_t{0}, tasks.size(), [&](std::size_t i) {
    const ExactTask& t = tasks[i];
    if (first[i] == i) answers[i] = exact_answer(t.run, t.parameters, t.path, bur_library);
  });
  for (std::size_t i = 0; i < tasks.size(); ++i)
    if (first[i] != i) answers[i] = answers[first[i]];
  return answers;
}

std::vector<Stretch> fully_engaged(const Exact& exact) {
  PerTissue<double> most{};
  for (const PerTissue<double>& area : exact.area)
    for (int k = 0; k < kTissueCount; ++k) most[k] = std::max(most[k], area[k]);
  double largest = 0;
  for (const double area : most) largest = std::max(largest, area);
  std::vector<Stretch> found;
  for (int k = 0; k < kTissueCount; ++k) {
    if (most[k] < 0.999 * largest || largest == 0) continue;
    Stretch s;
    s.tissue = tissue_at(k);
    bool any = false;
    for (std::size_t i = 0; i < exact.area.size(); ++i) {
      if (exact.area[i][k] < (1 - 1e-6) * largest || total(exact.area[i]) > (1 + 1e-6) * largest)
        continue;
      if (!any) s.first = i;
      s.last = i;
      any = true;
    }
    if (any) found.push_back(s);
  }
  return found;
}

std::vector<Stretch> plateaus(const Exact& exact) {
  std::vector<Stretch> found;
  for (Stretch s : fully_engaged(exact)) {
    const double settled = exact.force[s.last].norm();
    while (s.first < s.last && std::abs(exact.force[s.first].norm() - settled) > kSettled * settled)
      ++s.first;
    if (s.last - s.first > kLeastPlateau) found.push_back(s);
  }
  return found;
}

Deviation deviation(const Outcome& outcome, const Exact& exact) {
  const std::vector<StepRecord>& rows = outcome.replay.rows;
  const Scale scale = scale_of(exact);
  std::size_t first = rows.size(), last = 0;
  for (std::size_t i = 0; i < exact.force.size(); ++i)
    if (total(exact.area[i]) > 0 || rows[i].torque > 0) {
      first = std::min(first, i);
      last = i;
    }
  Deviation d;
  if (first > last || scale.force == 0) return d;
  for (std::size_t i = first; i <= last; ++i) {
    const double force = (rows[i].grinding_force - exact.force[i]).norm() / scale.force;
    const double torque = std::abs(rows[i].torque - exact.torque[i]) / scale.torque;
    d.force_rms += force * force;
    d.torque_rms += torque * torque;
    d.force_max = std::max(d.force_max, 100 * force);
    d.torque_max = std::max(d.torque_max, 100 * torque);
  }
  const auto n = static_cast<double>(last - first + 1);
  d.force_rms = 100 * std::sqrt(d.force_rms / n);
  d.torque_rms = 100 * std::sqrt(d.torque_rms / n);
  return d;
}

VoxelEffect voxel_effect(const Outcome& outcome, const Exact& exact, const Stretch& stretch) {
  const double scale = exact.force[stretch.last].norm();
  const double rate = 1 / outcome.parameters.time_step;
  VoxelEffect effect;
  std::vector<double> difference;
  for (int axis = 0; axis < 3; ++axis) {
    difference.clear();
    double sum = 0;
    for (std::size_t i = stretch.first; i <= stretch.last; ++i) {
      difference.push_back(outcome.replay.rows[i].grinding_force[axis] - exact.force[i][axis]);
      sum += difference.back() * difference.back();
    }
    effect.whole += sum / static_cast<double>(difference.size());
    // Two periods at least; NaN on a shorter plateau.
    const double high = static_cast<double>(difference.size()) > 2 * rate / kSlow
                            ? rms_above(difference, rate, kSlow)
                            : std::nan("");
    effect.above_2_hz += high * high;
  }
  effect.whole = 100 * std::sqrt(effect.whole) / scale;
  effect.above_2_hz = 100 * std::sqrt(effect.above_2_hz) / scale;
  return effect;
}

Level level(const Outcome& outcome, const Stretch& stretch) {
  Level l;
  const auto n = static_cast<double>(stretch.last - stretch.first + 1);
  for (std::size_t i = stretch.first; i <= stretch.last; ++i) {
    l.force += outcome.replay.rows[i].grinding_force / n;
    l.torque += outcome.replay.rows[i].torque / n;
  }
  return l;
}

Level level(const Exact& exact, const Stretch& stretch) {
  Level l;
  const auto n = static_cast<double>(stretch.last - stretch.first + 1);
  for (std::size_t i = stretch.first; i <= stretch.last; ++i) {
    l.force += exact.force[i] / n;
    l.torque += exact.torque[i] / n;
  }
  return l;
}

}  // namespace toothprep::figures
