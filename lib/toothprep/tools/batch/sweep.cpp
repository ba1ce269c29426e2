#include "toothprep/tools/batch/sweep.h"

#include <algorithm>
#include <set>
#include <unordered_map>

#include "toothprep/step/core/hash.h"

namespace toothprep {
namespace {

constexpr std::int64_t kMostSamples = 10'000'000;

bool good_name(const std::string& name) {
  return !name.empty() && name.size() <= 60 &&
         std::all_of(name.begin(), name.end(),
                     [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-'; });
}

// A range, or files by a pattern.
Factor factor_of_table(const std::string& name, StrictTable table, DesignKind kind,
                       const SweepHelp& help) {
  Factor f;
  f.name = name;
  if (const auto pattern = table.text("files")) {
    f.values = help.files(*pattern);
    if (f.values.empty())
      table.refuse("files", "matches no file", "patterns are relative to the manifest");
    table.done();
    return f;
  }
  const auto from = table.number("from"), to = table.number("to");
  if (!from) table.missing("from", "1.0, or give a list of values");
  if (!to) table.missing("to", "2.0");
  f.from = *from;
  f.to = *to;
  if (!std::isfinite(f.from) || !std::isfinite(f.to) || !(f.from < f.to))
    table.refuse("from", "must be a finite number below 'to'");
  f.logarithmic = table.choice("scale", {"linear", "log"}).value_or("linear") == "log";
  if (f.logarithmic && f.from <= 0) table.refuse("from", "must be above 0 for scale = \"log\"");
  f.whole = table.boolean("integer").value_or(false);
  const bool stepped = kind == DesignKind::kGrid || kind == DesignKind::kList;
  if (const auto steps = table.integer("steps")) {
    if (!stepped) table.refuse("steps", "is for grid and list; here 'samples' counts");
    if (*steps < 1 || *steps > kMostSamples) table.refuse("steps", "must be 1 to 10 million");
    f.steps = static_cast<std::size_t>(*steps);
  } else if (stepped) {
    table.missing("steps", "5");
  }
  table.done();
  return f;
}

std::vector<Factor> read_factors(const toml::table& node, StrictTable& sweep, DesignKind kind,
                                 const SweepHelp& help) {
  if (!sweep.table("over")) sweep.missing("over", "{ feed = [1, 2] }");
  std::vector<Factor> factors;
  for (const auto& [key, value] : *node["over"].as_table()) {
    const std::string name(key.str()), place = "over." + name.substr(0, 60);
    if (!good_name(name) || name == "name" || name == "file" || name == "repeat")
      sweep.refuse(place, "is no good name of a factor",
                   "use letters, digits, _ and -, and not name, file or repeat");
    if (const toml::table* table = value.as_table()) {
      factors.push_back(factor_of_table(
          name, StrictTable(*table, sweep.where(), sweep.path_of(place)), kind, help));
      continue;
    }
    Factor f;
    f.name = name;
    if (const toml::array* list = value.as_array())
      for (const toml::node& entry : *list) {
        const auto text = value_text_of(entry);
        if (!text || text->empty()) sweep.refuse(place, "must hold numbers or texts only");
        if (std::find(f.values.begin(), f.values.end(), *text) != f.values.end() &&
            kind != DesignKind::kList)
          sweep.refuse(place, "holds " + *text + " twice");
        f.values.push_back(*text);
      }
    if (f.values.empty())
      sweep.refuse(place, "must be a list of values, or { from = 1, to = 2, steps = 5 }");
    factors.push_back(std::move(f));
  }
  if (factors.empty()) sweep.refuse("over", "names no factor");
  // A table of TOML has no order of its own: by name.
  return factors;
}

Design read_design(const toml::table& node, StrictTable& table, const SweepHelp& help) {
  Design d;
  const std::vector<std::string> names = {"grid", "list", "lhs", "sobol"};
  const std::string kind = table.choice("design", names).value_or("grid");
  d.kind = static_cast<DesignKind>(std::find(names.begin(), names.end(), kind) - names.begin());
  const bool sampled = d.kind == DesignKind::kLatinHypercube || d.kind == DesignKind::kSobol;
  const auto samples = table.integer("samples");
  if (sampled && !samples) table.missing("samples", "100");
  if (!sampled && samples) table.refuse("samples", "is for lhs and sobol");
  if (samples && (*samples < 1 || *samples > kMostSamples))
    table.refuse("samples", "must be 1 to 10 million");
  d.samples = static_cast<std::size_t>(samples.value_or(0));
  if (const auto seed = table.integer("seed")) {
    if (d.kind != DesignKind::kLatinHypercube) table.refuse("seed", "is for lhs");
    if (*seed < 0) table.refuse("seed", "must not be negative");
    d.seed = static_cast<std::uint64_t>(*seed);
  }
  d.factors = read_factors(node, table, d.kind, help);
  for (const std::string& text : table.texts("where").value_or(std::vector<std::string>{})) try {
      Constraint c = parse_constraint(text);
      if (std::none_of(d.factors.begin(), d.factors.end(),
                       [&](const Factor& f) { return f.name == c.left || f.name == c.right; }))
        throw Error("names no factor");
      d.constraints.push_back(std::move(c));
    } catch (const Error& e) {
      table.refuse("where", "'" + text.substr(0, 80) + "' " + e.what());
    }
  return d;
}

SweepStep read_step(const toml::table& node, StrictTable& table, const SweepHelp& help) {
  SweepStep step;
  const auto name = table.text("name");
  if (!name) table.missing("name", "\"cut\"");
  if (!good_name(*name))
    table.refuse("name", "is no good name of a step", "use letters, digits, _ and -");
  step.name = *name;
  step.place = table.path_of("name");
  const auto command = help.command(table);
  if (!command) table.missing("command", "\"replay\"");
  step.command = *command;
  table.table("arguments");
  step.arguments =
      read_arguments(node["arguments"].as_table(), table.where(), table.path_of("arguments"));
  for (const auto& [option, argument] : *help.defaults)
    if (help.knows(step.command, option)) step.arguments.insert({option, argument});
  step.fill = table.texts("fill").value_or(std::vector<std::string>{});
  for (std::string& option : step.fill) {
    std::replace(option.begin(), option.end(), '_', '-');
    const auto found = step.arguments.find(option);
    if (found == step.arguments.end() || found->second.values.size() != 1)
      table.refuse("fill", "names '" + option + "', which is no argument with one file");
  }
  step.after = table.texts("after").value_or(std::vector<std::string>{});
  step.keep = read_keep(table);
  table.done();
  return step;
}

// Steps in an order in which each stands after those that it uses; `uses[i]`: of step i.
std::vector<std::size_t> ordered(const std::vector<SweepStep>& steps,
                                 const std::vector<std::set<std::size_t>>& uses,
                                 const std::string& where) {
  std::vector<std::size_t> order;
  std::vector<bool> placed(steps.size(), false);
  while (order.size() < steps.size()) {
    const std::size_t before = order.size();
    for (std::size_t i = 0; i < steps.size(); ++i)
      if (!placed[i] &&
          std::all_of(uses[i].begin(), uses[i].end(), [&](std::size_t u) { return placed[u]; })) {
        placed[i] = true;
        order.push_back(i);
      }
    if (order.size() == before) {
      std::string names;
      for (std::size_t i = 0; i < steps.size(); ++i)
        if (!placed[i]) names += (names.empty() ? "" : ", ") + steps[i].name;
      throw InputError(where, "sweep.step", "steps need one another: " + names);
    }
  }
  return order;
}

std::string item_name(const std::string& step, const std::vector<Factor>& factors,
                      const std::vector<std::string>& values) {
  std::string key;
  for (std::size_t k = 0; k < factors.size(); ++k)
    if (!values[k].empty()) key += factors[k].name + "=" + values[k] + "\n";
  if (key.empty()) return step;
  Sha256 hash;
  hash.update(key.data(), key.size());
  return step + "-" + hash.hex().substr(0, 12);
}

}  // namespace

BatchKeep read_keep(StrictTable& table) {
  const std::vector<std::string> names = {"all", "trace", "score"};
  const std::string name = table.choice("keep", names).value_or("all");
  return static_cast<BatchKeep>(std::find(names.begin(), names.end(), name) - names.begin());
}

Sweep read_sweep(const toml::table& node, StrictTable& table, const SweepHelp& help) {
  Sweep sweep;
  sweep.design = read_design(node, table, help);
  if (const auto repeat = table.integer("repeat")) {
    if (*repeat < 1 || *repeat > kMostSamples) table.refuse("repeat", "must be 1 to 10 million");
    sweep.repeat = static_cast<std::size_t>(*repeat);
  }
  auto steps = table.tables("step");
  if (!steps || steps->empty()) table.missing("step", "... as tables [[sweep.step]]");
  for (std::size_t i = 0; i < steps->size(); ++i) {
    sweep.steps.push_back(
        read_step(*node["step"].as_array()->get(i)->as_table(), (*steps)[i], help));
    for (std::size_t j = 0; j < i; ++j)
      if (sweep.steps[j].name == sweep.steps[i].name)
        throw InputError(table.where(), sweep.steps[i].place, "is used twice");
  }
  table.done();
  return sweep;
}

SweepPlan plan_sweep(const Sweep& sweep, const std::vector<std::vector<std::string>>& texts,
                     const std::string& where) {
  SweepPlan plan;
  plan.factors = sweep.design.factors;
  std::vector<DesignPoint> points;
  try {
    points = points_of(sweep.design);
  } catch (const Error& e) {
    throw InputError(where, "sweep", e.what());
  }
  if (sweep.repeat > 1) plan.factors.push_back({"repeat", {}, 0, 0, 0, false, false});
  if (static_cast<double>(points.size()) * static_cast<double>(sweep.repeat) > 1e7)
    throw InputError(where, "sweep", "has more than 10 million points");
  plan.points = points.size() * sweep.repeat;

  // What each step uses: factors and other steps, by itself and through those.
  const std::size_t n = sweep.steps.size();
  std::vector<std::set<std::size_t>> uses(n), factors(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::vector<std::string> places = texts[i];
    for (const auto& [option, argument] : sweep.steps[i].arguments)
      places.insert(places.end(), argument.values.begin(), argument.values.end());
    for (const std::string& text : places) {
      for (std::size_t k = 0; k < plan.factors.size(); ++k)
        if (text.find("{" + plan.factors[k].name + "}") != std::string::npos) factors[i].insert(k);
      for (std::size_t j = 0; j < n; ++j)
        if (text.find("{" + sweep.steps[j].name + "/") != std::string::npos) uses[i].insert(j);
    }
    for (std::size_t j = 0; j < n; ++j)
      if (std::count(sweep.steps[i].after.begin(), sweep.steps[i].after.end(), sweep.steps[j].name))
        uses[i].insert(j);
  }
  const std::vector<std::size_t> order = ordered(sweep.steps, uses, where);
  for (const std::size_t i : order)
    for (const std::size_t j : uses[i]) factors[i].insert(factors[j].begin(), factors[j].end());
  for (std::size_t k = 0; k < plan.factors.size(); ++k)
    if (std::none_of(factors.begin(), factors.end(), [&](const auto& f) { return f.count(k) > 0; }))
      throw InputError(
          where, k < points[0].size() ? "sweep.over." + plan.factors[k].name : "sweep.repeat",
          "is used by no step", "write {" + plan.factors[k].name + "} where its value goes");

  std::vector<std::unordered_map<std::string, std::size_t>> known(n);  // by the item's name
  for (const DesignPoint& point : points)
    for (std::size_t r = 1; r <= sweep.repeat; ++r) {
      std::vector<std::size_t> item_of(n);
      for (const std::size_t i : order) {
        SweepItem item;
        item.step = i;
        item.values.resize(plan.factors.size());
        for (const std::size_t k : factors[i])
          item.values[k] = k < point.size() ? point[k] : std::to_string(r);
        item.name = item_name(sweep.steps[i].name, plan.factors, item.values);
        const auto [place, fresh] = known[i].try_emplace(item.name, plan.items.size());
        item_of[i] = place->second;
        if (!fresh) continue;
        for (const std::size_t j : uses[i]) item.from[sweep.steps[j].name] = item_of[j];
        plan.items.push_back(std::move(item));
      }
    }
  return plan;
}

}  // namespace toothprep
