#include "toothprep/tools/score_report/plots.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/score_report/markup.h"

namespace toothprep {
namespace {

std::string rect(double x, double y, double w, double h, const char* style,
                 const std::string& title = {}) {
  std::string svg = std::string("<rect class=\"") + style + "\" x=\"" + short_number(x) +
                    "\" y=\"" + short_number(y) + "\" width=\"" + short_number(w) + "\" height=\"" +
                    short_number(h) + "\"";
  return svg + (title.empty() ? "/>\n" : "><title>" + escaped(title) + "</title></rect>\n");
}

std::string line(double x1, double y1, double x2, double y2, const char* style) {
  return std::string("<line class=\"") + style + "\" x1=\"" + short_number(x1) + "\" y1=\"" +
         short_number(y1) + "\" x2=\"" + short_number(x2) + "\" y2=\"" + short_number(y2) +
         "\"/>\n";
}

std::string text(double x, double y, const char* anchor, const char* style,
                 const std::string& words) {
  return std::string("<text class=\"") + style + "\" text-anchor=\"" + anchor + "\" x=\"" +
         short_number(x) + "\" y=\"" + short_number(y) + "\">" + escaped(words) + "</text>\n";
}

std::string svg_head(const char* label, double width, double height) {
  const std::string w = short_number(width), h = short_number(height);
  return std::string("<svg class=\"plot\" role=\"img\" aria-label=\"") + label +
         "\" viewBox=\"0 0 " + w + " " + h + "\" width=\"" + w + "\" height=\"" + h + "\">\n";
}

// Linear, from data to px.
struct Axis {
  double low = 0, high = 1, from = 0, to = 1;
  double operator()(double x) const { return from + (x - low) / (high - low) * (to - from); }
};

// The ticks' values within the axis.
std::vector<double> ticks(const Axis& axis, double step) {
  std::vector<double> values;
  for (double i = std::ceil(axis.low / step - 1e-6); i * step <= axis.high + 1e-6 * step; i += 1)
    values.push_back(i * step);
  return values;
}

double round_up(double value) {
  if (!(value > 0)) return 1;
  const double step = tick_step(value, 4);
  return std::ceil(value / step - 1e-9) * step;
}

const char* style_of(ProcessEventKind kind) {
  switch (kind) {
    case ProcessEventKind::kContact:
      return "ev-contact";
    case ProcessEventKind::kStall:
      return "ev-stall";
    case ProcessEventKind::kPulp:
      return "ev-pulp";
    case ProcessEventKind::kNeighbour:
      return "ev-neighbour";
    case ProcessEventKind::kForceLimit:
      return "ev-force";
  }
  return "";
}

}  // namespace

DeviationHistogram deviation_histogram(const std::vector<double>& deviation_mm,
                                       const std::vector<double>& area) {
  if (!area.empty() && area.size() != deviation_mm.size())
    throw Error("a histogram of " + std::to_string(deviation_mm.size()) + " deviations has " +
                std::to_string(area.size()) + " areas");
  std::vector<std::pair<double, double>> values;  // |deviation|, area
  values.reserve(deviation_mm.size());
  double total = 0;
  const auto weight = [&](std::size_t i) { return area.empty() ? 1.0 : area[i]; };
  const auto counts = [&](std::size_t i) {
    return std::isfinite(deviation_mm[i]) && std::isfinite(weight(i)) && weight(i) > 0;
  };
  for (std::size_t i = 0; i < deviation_mm.size(); ++i)
    if (counts(i)) {
      values.emplace_back(std::abs(deviation_mm[i]), weight(i));
      total += weight(i);
    }
  if (values.empty()) throw Error("a histogram needs a deviation that is finite");
  std::sort(values.begin(), values.end());
  double passed = 0, central = values.back().first;
  for (const auto& [d, a] : values)
    if ((passed += a) >= 0.99 * total) {
      central = d;
      break;
    }
  constexpr std::size_t kBins = 60;  // even: 0 is an edge
  const double end = std::clamp(std::ceil(central * 10 - 1e-9) / 10, 0.3, 2.0);
  DeviationHistogram h;
  h.low = -end;
  h.bin = 2 * end / kBins;
  h.share.assign(kBins, 0);
  for (std::size_t i = 0; i < deviation_mm.size(); ++i) {
    if (!counts(i)) continue;
    const double place = std::floor((deviation_mm[i] - h.low) / h.bin), part = weight(i) / total;
    if (deviation_mm[i] < h.low)
      h.below += part;
    else if (deviation_mm[i] > end)
      h.above += part;
    else
      h.share[std::min(kBins - 1, static_cast<std::size_t>(std::max(0.0, place)))] += part;
  }
  return h;
}

DeviationHistogram deviation_histogram(double low, double bin, const std::vector<double>& area) {
  const std::size_t n = area.size();
  if (!(bin > 0) || !(std::abs(2 * low + bin * static_cast<double>(n)) <= 1e-6 * bin))
    throw Error("a histogram of deviations must have bins symmetric about 0");
  double total = 0;
  for (const double a : area) {
    if (!(a >= 0 && std::isfinite(a))) throw Error("a histogram's areas must be 0 or more");
    total += a;
  }
  if (!(total > 0)) throw Error("a histogram needs some area");
  // Take away bins on both sides while 99 % stay.
  std::size_t cut = 0;
  double outside = 0;
  while (2 * (cut + 1) < n && low + bin * static_cast<double>(cut + 1) <= -0.3 + 1e-9) {
    const double more = area[cut] + area[n - 1 - cut];
    if (outside + more > 0.01 * total) break;
    outside += more;
    ++cut;
  }
  DeviationHistogram h;
  h.low = low + bin * static_cast<double>(cut);
  h.bin = bin;
  for (std::size_t i = 0; i < n; ++i) {
    const double part = area[i] / total;
    if (i < cut)
      h.below += part;
    else if (i >= n - cut)
      h.above += part;
    else
      h.share.push_back(part);
  }
  return h;
}

std::string deviation_svg(const DeviationHistogram& h) {
  constexpr double kWidth = 860, kHeight = 300, kLeft = 56, kRight = 20, kTop = 34, kBottom = 52;
  const double end = h.low + h.bin * static_cast<double>(h.share.size());
  const Axis x{h.low, end, kLeft, kWidth - kRight};
  const double most = h.share.empty() ? 0 : *std::max_element(h.share.begin(), h.share.end());
  const Axis y{0, round_up(100 * most), kHeight - kBottom, kTop};
  std::string svg = svg_head("Deviation from the target", kWidth, kHeight);
  const auto band = [&](double limit, const char* style) {
    const double from = x(std::max(-limit, h.low)), to = x(std::min(limit, end));
    svg += rect(from, kTop, to - from, y.from - kTop, style);
  };
  band(0.2, "band2");
  band(0.1, "band1");
  const double step_y = tick_step(y.high, 4);
  for (const double v : ticks(y, step_y)) {
    svg += line(kLeft, y(v), kWidth - kRight, y(v), "grid");
    svg += text(kLeft - 8, y(v) + 4, "end", "small", tick_text(v, step_y));
  }
  for (std::size_t i = 0; i < h.share.size(); ++i) {
    if (h.share[i] <= 0) continue;
    const double from = h.low + h.bin * static_cast<double>(i);
    const double middle = from + h.bin / 2;
    const double top = y(100 * h.share[i]);
    svg += rect(x(from) + 0.5, top, x(from + h.bin) - x(from) - 1, y.from - top,
                middle < 0 ? "bar-taken" : "bar-left",
                short_number(from, 3) + " to " + short_number(from + h.bin, 3) +
                    " mm: " + short_number(100 * h.share[i], 2) + " %");
  }
  svg += line(kLeft, y.from, kWidth - kRight, y.from, "axis");
  svg += line(x(0), kTop, x(0), y.from, "zero");
  const double step_x = tick_step(end - h.low, 6);
  for (const double v : ticks(x, step_x)) {
    svg += line(x(v), y.from, x(v), y.from + 5, "axis");
    svg += text(x(v), y.from + 19, "middle", "small", tick_text(v, step_x));
  }
  svg += text((kLeft + kWidth - kRight) / 2, kHeight - 12, "middle", "small",
              "deviation from the target, mm");
  svg += text(kLeft, kHeight - 12, "start", "small taken", "\u2190 too much taken");
  svg += text(kWidth - kRight, kHeight - 12, "end", "small left", "material left \u2192");
  svg += text(kLeft - 40, kTop - 14, "start", "small", "share of the surface, %");
  svg += text(x(0), kTop - 14, "middle", "small", "bands: \u00b10.1 and \u00b10.2 mm");
  for (const auto& [share, at, anchor] :
       {std::tuple(h.below, kLeft + 4, "start"), std::tuple(h.above, kWidth - kRight - 4, "end")})
    if (share > 0.00005)
      svg += text(at, kTop + 12, anchor, "small",
                  short_number(100 * share, share < 0.001 ? 2 : 1) + " % beyond");
  return svg + "</svg>\n";
}

TracePlot trace_plot(const std::vector<StepRecord>& rows, const std::vector<ProcessEvent>& events,
                     const ProcessOptions& options, std::size_t columns) {
  if (rows.size() < 2) throw Error("the recording holds no step: two rows are needed");
  TracePlot plot;
  plot.begin = rows.front().handle.time;
  plot.end = rows.back().handle.time;
  plot.events = events;
  plot.force_limit = options.force_limit;
  plot.power_limit = units::to_watt(options.power_limit);
  plot.columns.resize(std::max<std::size_t>(columns, 1));
  const double per_second = static_cast<double>(plot.columns.size()) / (plot.end - plot.begin);
  for (const StepRecord& row : rows) {
    const double place = (row.handle.time - plot.begin) * per_second;
    auto& column = plot.columns[std::min(plot.columns.size() - 1, static_cast<std::size_t>(place))];
    const double force = row.grinding_force.norm(), felt = row.device_force.norm();
    column.force_least = column.any ? std::min(column.force_least, force) : force;
    column.felt_least = column.any ? std::min(column.felt_least, felt) : felt;
    column.force_most = std::max(column.force_most, force);
    column.felt_most = std::max(column.felt_most, felt);
    column.power_most = std::max(column.power_most, units::to_watt(row.power));
    column.any = true;
  }
  return plot;
}

namespace {

// The plot of a recording: lanes of events over a panel of forces and one of power.
class TraceDrawing {
 public:
  explicit TraceDrawing(const TracePlot& plot) : plot_(plot) {
    for (const ProcessEventKind kind :
         {ProcessEventKind::kContact, ProcessEventKind::kForceLimit, ProcessEventKind::kStall,
          ProcessEventKind::kPulp, ProcessEventKind::kNeighbour})
      if (count(kind) > 0) lanes_.push_back(kind);
    const double force_top = kTop + kLane * static_cast<double>(lanes_.size()) + kGap;
    const double power_top = force_top + kForce + kGap;
    height_ = power_top + kPower + kBottom;
    double most_force = 0, most_power = 0;
    for (const Column& c : plot.columns) {
      most_force = std::max({most_force, c.force_most, c.felt_most});
      most_power = std::max(most_power, c.power_most);
    }
    time_ = {plot.begin, plot.end, kLeft, kRightEdge};
    force_ = {0, round_up(most_force), force_top + kForce, force_top};
    power_ = {0, round_up(most_power), power_top + kPower, power_top};
  }

  std::string svg() {
    svg_ = svg_head("Forces, power and events of the recording", kWidth, height_);
    shade();  // first, then what is drawn over it
    draw_lanes();
    draw_panel(force_, 4, "force, N");
    draw_panel(power_, 2, "grinding power, W (largest)");
    draw_envelope(
        force_, [](const Column& c) { return c.force_least; },
        [](const Column& c) { return c.force_most; }, "curve-force");
    draw_envelope(
        force_, [](const Column& c) { return c.felt_least; },
        [](const Column& c) { return c.felt_most; }, "curve-felt");
    draw_envelope(
        power_, [](const Column&) { return 0.0; }, [](const Column& c) { return c.power_most; },
        "curve-power");
    draw_limit(force_, plot_.force_limit, " N");
    draw_limit(power_, plot_.power_limit, " W");
    draw_key();
    draw_time();
    return svg_ + "</svg>\n";
  }

 private:
  using Column = TracePlot::Column;
  static constexpr double kWidth = 860, kLeft = 142, kRightEdge = 840, kTop = 8, kLane = 17;
  static constexpr double kGap = 30, kForce = 180, kPower = 90, kBottom = 46;

  std::ptrdiff_t count(ProcessEventKind kind) const {
    return std::count_if(plot_.events.begin(), plot_.events.end(),
                         [&](const ProcessEvent& e) { return e.kind == kind; });
  }

  void shade() {
    for (const ProcessEvent& e : plot_.events) {
      if (e.kind == ProcessEventKind::kContact || e.kind == ProcessEventKind::kForceLimit) continue;
      const double from = time_(e.begin), width = std::max(1.0, time_(e.end) - from);
      const std::string style = std::string(style_of(e.kind)) + " shade";
      for (const Axis* y : {&force_, &power_})
        svg_ += rect(from, y->to, width, y->from - y->to, style.c_str());
    }
  }

  void draw_lanes() {
    double top = kTop;
    for (const ProcessEventKind kind : lanes_) {
      const std::string name = name_of(kind);
      svg_ += text(
          kLeft - 8, top + 12, "end", "small",
          name +
              (kind == ProcessEventKind::kContact ? "" : " \u00d7" + std::to_string(count(kind))));
      svg_ += rect(kLeft, top + 2, kRightEdge - kLeft, kLane - 5, "lane");
      for (const ProcessEvent& e : plot_.events)
        if (e.kind == kind)
          svg_ +=
              rect(time_(e.begin), top + 2, std::max(1.5, time_(e.end) - time_(e.begin)), kLane - 5,
                   style_of(kind),
                   name + ", " + short_number(e.begin, 2) + " to " + short_number(e.end, 2) + " s");
      top += kLane;
    }
  }

  void draw_panel(const Axis& y, int least, const std::string& title) {
    const double step = tick_step(y.high, least);
    for (const double v : ticks(y, step)) {
      svg_ += line(kLeft, y(v), kRightEdge, y(v), v == 0 ? "axis" : "grid");
      svg_ += text(kLeft - 8, y(v) + 4, "end", "small", tick_text(v, step));
    }
    svg_ += text(kLeft, y.to - 9, "start", "small", title);
  }

  // From least to most, column by column: a band that is a line where little changes.
  template <class Least, class Most>
  void draw_envelope(const Axis& y, Least least, Most most, const char* style) {
    std::string there, back;
    for (std::size_t i = 0; i < plot_.columns.size(); ++i) {
      const Column& c = plot_.columns[i];
      if (!c.any) continue;
      const double at = kLeft + (kRightEdge - kLeft) * (static_cast<double>(i) + 0.5) /
                                    static_cast<double>(plot_.columns.size());
      there += (there.empty() ? "M" : "L") + short_number(at) + " " + short_number(y(most(c)));
      back = "L" + short_number(at) + " " + short_number(y(least(c))) + back;
    }
    if (!there.empty())
      svg_ += std::string("<path class=\"") + style + "\" d=\"" + there + back + "Z\"/>\n";
  }

  void draw_limit(const Axis& y, double limit, const char* unit) {
    if (!(limit > 0 && limit <= y.high)) return;
    svg_ += line(kLeft, y(limit), kRightEdge, y(limit), "limit");
    svg_ += text(kRightEdge, y(limit) - 4, "end", "small limit-text",
                 "limit " + short_number(limit) + unit);
  }

  // Which curve is which.
  void draw_key() {
    svg_ += rect(kRightEdge - 236, force_.to - 18, 14, 9, "curve-force") +
            text(kRightEdge - 218, force_.to - 9, "start", "small", "grinding force") +
            rect(kRightEdge - 112, force_.to - 18, 14, 9, "curve-felt") +
            text(kRightEdge - 94, force_.to - 9, "start", "small", "felt by the hand");
  }

  void draw_time() {
    const double step = tick_step(plot_.end - plot_.begin, 6), bottom = power_.from;
    for (const double v : ticks(time_, step)) {
      svg_ += line(time_(v), bottom, time_(v), bottom + 5, "axis");
      svg_ += text(time_(v), bottom + 19, "middle", "small", tick_text(v, step));
    }
    svg_ += text((kLeft + kRightEdge) / 2, height_ - 8, "middle", "small", "time, s");
  }

  const TracePlot& plot_;
  std::vector<ProcessEventKind> lanes_;
  Axis time_{}, force_{}, power_{};
  double height_ = 0;
  std::string svg_;
};

}  // namespace

std::string trace_svg(const TracePlot& plot) { return TraceDrawing(plot).svg(); }

}  // namespace toothprep
