#include "toothprep/tools/rig_check/protocol.h"

#include <array>
#include <charconv>
#include <cmath>
#include <string_view>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/step/core/number_text.h"

namespace toothprep {
namespace {

constexpr std::array kKinds = {ProtocolKind::kRest, ProtocolKind::kStep,
                               ProtocolKind::kStiffnessSweep, ProtocolKind::kDampingSweep,
                               ProtocolKind::kWall};

// The words of a protocol, taken from the left.
class Words {
 public:
  Words(const std::string& text, ProtocolKind kind, std::size_t from)
      : text_(text), rest_(std::string_view(text).substr(from)), kind_(kind) {}

  bool done() {
    skip_spaces();
    return rest_.empty();
  }
  bool take(std::string_view word) {
    skip_spaces();
    if (rest_.substr(0, word.size()) != word) return false;
    rest_.remove_prefix(word.size());
    return true;
  }
  void expect(std::string_view word) {
    if (!take(word)) refuse("'" + std::string(word) + "'");
  }
  double number() { return read<double>("a number"); }
  int whole_number() { return read<int>("a whole number"); }
  void end() {
    if (!done()) refuse("the end");
  }

 private:
  template <class Number>
  Number read(const char* what) {
    skip_spaces();
    Number value{};
    // "0.2..2": the dots of the range are no part of the number.
    const std::string_view digits = rest_.substr(0, rest_.find(".."));
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error != std::errc() || !std::isfinite(static_cast<double>(value))) refuse(what);
    rest_.remove_prefix(static_cast<std::size_t>(end - digits.data()));
    return value;
  }
  void skip_spaces() {
    while (!rest_.empty() && rest_.front() == ' ') rest_.remove_prefix(1);
  }
  [[noreturn]] void refuse(const std::string& expected) const {
    throw Error(
        "protocol \"" + text_.substr(0, 100) + "\": expected " + expected +
        (rest_.empty() ? " at its end" : " at \"" + std::string(rest_.substr(0, 30)) + "\"") +
        "; it reads, e.g., \"" + print_protocol(default_protocol(kind_)) + "\"");
  }

  const std::string& text_;
  std::string_view rest_;
  ProtocolKind kind_;
};

bool is_sweep(ProtocolKind kind) {
  return kind == ProtocolKind::kStiffnessSweep || kind == ProtocolKind::kDampingSweep;
}

}  // namespace

const char* name_of(ProtocolKind kind) noexcept {
  switch (kind) {
    case ProtocolKind::kRest:
      return "rest";
    case ProtocolKind::kStep:
      return "step";
    case ProtocolKind::kStiffnessSweep:
      return "stiffness-sweep";
    case ProtocolKind::kDampingSweep:
      return "damping-sweep";
    case ProtocolKind::kWall:
      return "wall";
  }
  return "";
}

Protocol default_protocol(ProtocolKind kind) {
  Protocol p;
  p.kind = kind;
  switch (kind) {
    case ProtocolKind::kRest:
      p.duration_s = 10;
      break;
    case ProtocolKind::kStep:
      p.force_n = 0.5;
      p.duration_s = 2;
      break;
    case ProtocolKind::kStiffnessSweep:
      p.from = 0.2;
      p.to = 2;
      p.count = 10;
      p.hold_s = 2;
      break;
    case ProtocolKind::kDampingSweep:
      p.from = 1;
      p.to = 100;
      p.count = 9;
      p.hold_s = 2;
      p.geometric = true;
      break;
    case ProtocolKind::kWall:
      p.stiffness_n_per_mm = 1;
      p.travel_mm = 3;
      p.duration_s = 10;
      break;
  }
  return p;
}

void validate(const Protocol& p) {
  const auto within = [&](double value, double most, const char* name, double least = 0) {
    const bool above = least > 0 ? value >= least : value > 0;
    if (!(std::isfinite(value) && above && value <= most))
      throw Error(std::string("protocol ") + name_of(p.kind) + ": " + name + " must be " +
                  (least > 0 ? "at least " + shortest_text(least) : "above 0") + " and at most " +
                  shortest_text(most));
  };
  if (is_sweep(p.kind)) {
    const double most = p.kind == ProtocolKind::kStiffnessSweep ? 10 : 10000;
    within(p.from, most, "the first level");
    within(p.to, most, "the last level");
    if (!(p.from < p.to))
      throw Error(std::string("protocol ") + name_of(p.kind) +
                  ": the last level must be above the first");
    within(p.count, 100, "the number of steps", 2);
    within(p.hold_s, 60, "the time of a step (s)", 0.5);
    return;
  }
  within(p.duration_s, 3600, "the duration (s)");
  if (p.kind == ProtocolKind::kStep) within(p.force_n, 5, "the force (N)");
  if (p.kind == ProtocolKind::kWall) {
    within(p.stiffness_n_per_mm, 10, "the stiffness (N/mm)");
    within(p.travel_mm, 50, "the travel (mm)");
  }
}

Protocol parse_protocol(const std::string& text) {
  const std::size_t begin = text.find_first_not_of(' ');
  const std::size_t end = begin == std::string::npos ? begin : text.find(' ', begin);
  const std::string name =
      begin == std::string::npos ? "" : text.substr(begin, end == text.npos ? end : end - begin);
  std::vector<std::string> names;
  std::string list;
  for (const ProtocolKind kind : kKinds) {
    names.emplace_back(name_of(kind));
    list += (list.empty() ? "" : ", ") + names.back();
    if (name != names.back()) continue;
    Words words(text, kind, end == text.npos ? text.size() : end);
    Protocol p = default_protocol(kind);
    if (words.done()) return p;
    switch (kind) {
      case ProtocolKind::kRest:
        p.duration_s = words.number();
        break;
      case ProtocolKind::kStep:
        p.force_n = words.number();
        words.expect("N");
        words.expect("for");
        p.duration_s = words.number();
        break;
      case ProtocolKind::kStiffnessSweep:
      case ProtocolKind::kDampingSweep:
        p.from = words.number();
        words.expect("..");
        p.to = words.number();
        if (kind == ProtocolKind::kStiffnessSweep)
          words.expect("N/mm");
        else if (!words.take("N\u00b7s/m"))
          words.expect("N*s/m");
        words.expect("in");
        p.count = words.whole_number();
        p.geometric = words.take("geometric");
        words.expect("steps");
        words.expect("of");
        p.hold_s = words.number();
        break;
      case ProtocolKind::kWall:
        p.stiffness_n_per_mm = words.number();
        words.expect("N/mm");
        words.expect("travel");
        p.travel_mm = words.number();
        words.expect("mm");
        words.expect("for");
        p.duration_s = words.number();
        break;
    }
    words.expect("s");
    words.end();
    validate(p);
    return p;
  }
  throw Error("protocol \"" + text.substr(0, 100) + "\" is not known (known: " + list +
              "); did you mean \"" + nearest_name(name, names) + "\"?");
}

std::string print_protocol(const Protocol& p) {
  std::string name = name_of(p.kind);
  switch (p.kind) {
    case ProtocolKind::kRest:
      return name + " " + shortest_text(p.duration_s) + " s";
    case ProtocolKind::kStep:
      return name + " " + shortest_text(p.force_n) + " N for " + shortest_text(p.duration_s) + " s";
    case ProtocolKind::kStiffnessSweep:
    case ProtocolKind::kDampingSweep:
      return name + " " + shortest_text(p.from) + ".." + shortest_text(p.to) +
             (p.kind == ProtocolKind::kStiffnessSweep ? " N/mm in " : " N*s/m in ") +
             std::to_string(p.count) + (p.geometric ? " geometric" : "") + " steps of " +
             shortest_text(p.hold_s) + " s";
    case ProtocolKind::kWall:
      return name + " " + shortest_text(p.stiffness_n_per_mm) + " N/mm travel " +
             shortest_text(p.travel_mm) + " mm for " + shortest_text(p.duration_s) + " s";
  }
  return name;
}

double protocol_duration(const Protocol& p) noexcept {
  return kProtocolLead + (is_sweep(p.kind) ? p.count * p.hold_s : p.duration_s);
}

std::optional<int> protocol_level_at(const Protocol& p, double time) noexcept {
  if (!is_sweep(p.kind) || !(time >= kProtocolLead)) return {};
  const double level = std::floor((time - kProtocolLead) / p.hold_s);
  if (!(level < p.count)) return {};
  return static_cast<int>(level);
}

double protocol_level(const Protocol& p, int level) noexcept {
  if (level <= 0) return p.from;
  if (level >= p.count - 1) return p.to;
  const double part = static_cast<double>(level) / (p.count - 1);
  return p.geometric ? p.from * std::pow(p.to / p.from, part) : p.from + part * (p.to - p.from);
}

bool protocol_step_on(const Protocol& p, double time) noexcept {
  const double t = (time - kProtocolLead) / p.duration_s;
  return p.kind == ProtocolKind::kStep && t >= 0.25 && t < 0.75;
}

}  // namespace toothprep
