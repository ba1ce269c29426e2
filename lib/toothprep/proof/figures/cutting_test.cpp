#include "toothprep/proof/figures/cutting_test.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>

#include "toothprep/step/core/strict_toml.h"

namespace toothprep::figures {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostCuts = 32;  // of a test, for each set of parameters

struct QuantityName {
  const char* name;
  const char* unit;
  Quantity quantity;
};
constexpr QuantityName kQuantities[] = {
    {"removal_rate_mm3_s", "mm³/s", Quantity::kRemovalRate},
    {"mass_rate_mg_s", "mg/s", Quantity::kMassRate},
    {"cut_time_s", "s", Quantity::kCutTime},
    {"feed_mm_s", "mm/s", Quantity::kFeed},
    {"force_per_feed_n_s_mm", "N·s/mm", Quantity::kForcePerFeed},
    {"tangential_force_n", "N", Quantity::kTangentialForce},
    {"normal_force_n", "N", Quantity::kNormalForce},
    {"force_ratio", "1", Quantity::kForceRatio},
    {"speed_loss_percent", "%", Quantity::kSpeedLoss},
    {"specific_energy_j_mm3", "J/mm³", Quantity::kSpecificEnergy},
    {"load_gain", "1", Quantity::kLoadGain},
    {"stall_load_n", "N", Quantity::kStallLoad},
    {"peak_power_speed_ratio", "1", Quantity::kPeakPowerSpeed}};

constexpr std::pair<const char*, double Cut::*> kNumbers[] = {
    {"diameter_mm", &Cut::diameter},    {"length_mm", &Cut::length},
    {"depth_mm", &Cut::depth},          {"load_n", &Cut::load},
    {"feed_mm_s", &Cut::feed},          {"electric_rate_rev_s", &Cut::electric_rate},
    {"rate_factor", &Cut::rate_factor}, {"torque_factor", &Cut::torque_factor},
    {"density_mg_mm3", &Cut::density},  {"way_mm", &Cut::way}};

// All combinations of what stands in `cuts` with the values of one key.
template <class T, class Set>
void combine(std::vector<Cut>& cuts, const std::vector<T>& values, const Set& set) {
  std::vector<Cut> all;
  for (const Cut& cut : cuts)
    for (const T& value : values) {
      all.push_back(cut);
      set(all.back(), value);
    }
  cuts = std::move(all);
}

// The keys of a cut, over `cuts`. A list is all that is possible.
std::vector<Cut> read_cuts(StrictTable& table, std::vector<Cut> cuts) {
  static const std::map<std::string, CutGeometry> kGeometries = {
      {"full-slot", CutGeometry::kFullSlot},
      {"half-slot", CutGeometry::kHalfSlot},
      {"skim", CutGeometry::kSkim},
      {"face", CutGeometry::kFace}};
  if (const auto x = table.choice("geometry", {"full-slot", "half-slot", "skim", "face"}))
    for (Cut& cut : cuts) cut.geometry = kGeometries.at(*x);
  if (const auto x = table.texts("tissue")) {
    for (const std::string& name : *x)
      if (name != "enamel" && name != "dentin")
        table.refuse("tissue", "must be \"enamel\" or \"dentin\"");
    combine(cuts, *x, [](Cut& cut, const std::string& name) {
      cut.tissue = name == "enamel" ? Tissue::kEnamel : Tissue::kDentin;
    });
  }
  if (const auto x = table.texts("cutting")) {
    for (const std::string& name : *x)
      if (name != "up" && name != "down") table.refuse("cutting", "must be \"up\" or \"down\"");
    combine(cuts, *x, [](Cut& cut, const std::string& name) { cut.climb = name == "down"; });
  }
  for (const auto& [key, member] : kNumbers)
    if (const auto x = table.numbers(key)) {
      if (x->empty()) table.refuse(key, "is an empty list");
      for (const double value : *x)
        if (!(value > 0)) table.refuse(key, "must be positive");
      combine(cuts, *x, [member = member](Cut& cut, double value) { cut.*member = value; });
    }
  if (cuts.size() > kMostCuts)
    table.refuse("geometry", "stands beside lists that make " + std::to_string(cuts.size()) +
                                 " cuts, more than " + std::to_string(kMostCuts));
  for (const Cut& cut : cuts) {
    if ((cut.load > 0) == (cut.feed > 0)) table.missing("load_n", "[1.0] or feed_mm_s = [1.0]");
    if (cut.depth == 0 &&
        (cut.geometry == CutGeometry::kSkim || cut.geometry == CutGeometry::kFace))
      table.missing("depth_mm", "[0.1]");
    if (cut.depth > cut.diameter / 2) table.refuse("depth_mm", "is above half of diameter_mm");
  }
  table.done();
  return cuts;
}

std::set<std::string> known_rows(const std::string& file) {
  std::set<std::string> ids;
  std::ifstream in(file);
  if (!in) throw InputError(file, "", "cannot be read");
  for (std::string line; std::getline(in, line);) ids.insert(line.substr(0, line.find(',')));
  return ids;
}

CuttingTest read_test(const std::string& file, const std::set<std::string>& ids) {
  const toml::table document = parse_toml(read_small_text(file), file);
  StrictTable root(document, file);
  CuttingTest test;
  test.name = fs::path(file).stem().string();
  test.title = root.text("title").value_or(test.name);
  test.rows = root.texts("rows").value_or(std::vector<std::string>{});
  for (const std::string& row : test.rows)
    if (ids.count(row) == 0) root.refuse("rows", "\"" + row + "\" is not in measurements.csv");
  test.assumes = root.texts("assumes").value_or(std::vector<std::string>{});
  test.confidence = root.choice("confidence", {"high", "medium", "low"}).value_or("low");
  std::vector<std::string> names;
  for (const QuantityName& q : kQuantities) names.emplace_back(q.name);
  const auto quantity = root.choice("quantity", names);
  if (!quantity) root.missing("quantity", "\"feed_mm_s\"");
  for (const QuantityName& q : kQuantities)
    if (q.name == *quantity) {
      test.quantity = q.quantity;
      test.unit = q.unit;
    }
  test.quantity_name = *quantity;
  const auto measured = root.range("measured");
  test.observed = root.choice("observed", {"rises", "falls", "level"}).value_or("");
  if (measured.has_value() != test.observed.empty())
    root.missing("measured", "[1.0, 2.0] or observed = \"rises\", one of them");
  if (measured) test.measured = *measured;
  if (measured && !(test.measured[0] > 0)) root.refuse("measured", "must be positive");
  auto cut = root.table("cut");
  if (!cut) root.missing("cut", "... a table [cut]");
  auto second = root.table("second");
  if (second.has_value() == test.observed.empty())
    root.missing("observed", "\"rises\" and a table [second], or neither");
  test.cuts = read_cuts(*cut, {Cut{}});
  if (second) {
    if (second->has("load_n") && test.cuts.front().feed > 0)
      second->refuse("load_n", "stands beside the feed of [cut]");
    test.second = read_cuts(*second, test.cuts);
    if (test.second.size() != test.cuts.size())
      second->refuse("rate_factor", "holds lists: one value of each is compared with [cut]");
  }
  root.done();
  return test;
}

}  // namespace

std::vector<CuttingTest> read_cutting_tests(const std::string& folder) {
  const std::set<std::string> ids = known_rows(folder + "/measurements.csv");
  std::vector<std::string> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder + "/tests", error))
    if (entry.path().extension() == ".toml") files.push_back(entry.path().string());
  if (files.empty()) throw InputError(folder + "/tests", "", "holds no test (.toml)");
  std::sort(files.begin(), files.end());
  std::vector<CuttingTest> tests;
  for (const std::string& file : files) tests.push_back(read_test(file, ids));
  return tests;
}

}  // namespace toothprep::figures
