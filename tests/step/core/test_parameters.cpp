#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

std::string parse_error(const std::string& toml) {
  return error_of([&] { static_cast<void>(parse_parameters(toml, "p.toml")); });
}

// Every number and choice as text that distinguishes any two doubles.
std::string bits(const Parameters& p) {
  std::string text = p.preset;
  const auto add = [&](double x) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, " %a", x);
    text += buffer;
  };
  for (const auto& t : p.tissue) {
    add(t.specific_energy);
    add(t.force_ratio);
  }
  add(p.handpiece.rotation_rate);
  add(p.handpiece.stall_torque);
  add(p.handpiece.clockwise);
  add(static_cast<int>(p.handpiece.model));
  add(static_cast<int>(p.handpiece.stall_rule));
  add(p.handpiece.droop_exponent);
  add(p.handpiece.rotor_inertia);
  add(p.handpiece.run_down);
  add(p.coupling.stiffness);
  add(p.coupling.damping);
  add(p.coupling.bur_mass);
  add(p.coupling.attached_without_contact);
  add(p.load.max_speed);
  for (const double x : p.load.rail) add(x);
  add(p.time_step);
  add(static_cast<int>(p.engine));
  add(p.element_size);
  add(p.trailing_elements);
  add(p.rotation_feed);
  return text;
}

TEST(Parameters, AnEmptyFileIsThePaper) {
  const Parameters p = parse_parameters("", "p.toml");
  EXPECT_EQ(p.preset, "paper");
  // Section 5 of the paper: 0.3 and 0.1 J/mm3, i.e. 300 and 100 N/mm2.
  EXPECT_DOUBLE_EQ(p.tissue[tissue_index(Tissue::kEnamel)].specific_energy, 300);
  EXPECT_DOUBLE_EQ(p.tissue[tissue_index(Tissue::kDentin)].specific_energy, 100);
  EXPECT_DOUBLE_EQ(p.tissue[tissue_index(Tissue::kPulp)].specific_energy, 10);
  for (const auto& t : p.tissue) EXPECT_EQ(t.force_ratio, 0.25);
  EXPECT_EQ(p.coupling.bur_mass, 8e-6);  // 8 g in tonnes
  EXPECT_EQ(bits(p), bits(preset_parameters("paper")));
}

TEST(Parameters, TheFilesPresetWinsOverTheDefaultOne) {
  EXPECT_EQ(parse_parameters("", "p", "physical").handpiece.rotation_rate, 5000);
  const Parameters p = parse_parameters("preset = 'physical'\n[handpiece]\nmodel='fixed'", "p");
  EXPECT_EQ(p.handpiece.rotation_rate, 5000);
  EXPECT_EQ(p.handpiece.model, HandpieceModel::kFixed);
  EXPECT_THAT(error_of([] { static_cast<void>(preset_parameters("Paper")); }), HasSubstr("paper"));
}

TEST(Parameters, EveryKeyReachesItsPlaceInInternalUnits) {
  const Parameters p = parse_parameters(R"(
preset = "paper"
[tissue.enamel]
specific_energy_j_per_mm3 = 2
force_ratio = 0.5
[tissue.dentin]
specific_energy_j_per_mm3 = 0
[tissue.pulp]
force_ratio = 3
[tissue.other]
specific_energy_j_per_mm3 = 0.25
[handpiece]
rotation_rate_rev_s = 250
stall_torque_mnm = inf
clockwise = false
model = "droop"
droop_exponent = 2.5
[coupling]
stiffness_n_per_mm = 0.5
damping_n_s_per_mm = 0.002
bur_mass_g = 16
[step]
time_step_s = 0.0005
rotation_feed = false
[engine]
kind = "voxel"
)",
                                        "p.toml");
  EXPECT_EQ(p.tissue[0].specific_energy, 2000);
  EXPECT_EQ(p.tissue[0].force_ratio, 0.5);
  EXPECT_EQ(p.tissue[1].specific_energy, 0);
  EXPECT_EQ(p.tissue[2].force_ratio, 3);
  EXPECT_EQ(p.tissue[3].specific_energy, 250);
  EXPECT_EQ(p.handpiece.rotation_rate, 250);
  EXPECT_TRUE(std::isinf(p.handpiece.stall_torque));
  EXPECT_FALSE(p.handpiece.clockwise);
  EXPECT_EQ(p.handpiece.model, HandpieceModel::kDroop);
  EXPECT_EQ(p.handpiece.droop_exponent, 2.5);
  EXPECT_EQ(p.coupling.stiffness, 0.5);
  EXPECT_EQ(p.coupling.damping, 0.002);
  EXPECT_DOUBLE_EQ(p.coupling.bur_mass, 16e-6);
  EXPECT_EQ(p.time_step, 0.0005);
  EXPECT_FALSE(p.rotation_feed);
  EXPECT_EQ(p.engine, EngineKind::kVoxel);
}

TEST(Parameters, ALawBeyondThePapersIsReadAndSurvivesTheRoundTrip) {
  EXPECT_TRUE(is_linear(preset_parameters("paper")));
  EXPECT_TRUE(is_linear(preset_parameters("physical")));
  // What stays as in the paper is not written: programs that don't know the keys read the rest.
  EXPECT_EQ(to_toml(preset_parameters("paper")).find("size_exponent"), std::string::npos);
  EXPECT_EQ(to_toml(preset_parameters("paper")).find("rubbing"), std::string::npos);
  const Parameters p = parse_parameters(R"([tissue.enamel]
size_exponent = 0.4
ratio_exponent = -0.15
reference_chip_um = 0.3
rubbing_pressure_n_per_mm2 = 0.7
rubbing_friction = 0.2
up_cutting = -0.3
)",
                                        "p.toml");
  EXPECT_FALSE(is_linear(p));
  EXPECT_DOUBLE_EQ(p.tissue[0].reference_chip, 3e-4);
  EXPECT_EQ(p.tissue[0].ratio_exponent, -0.15);
  const Parameters back = parse_parameters(to_toml(p), "p.toml");
  for (int k = 0; k < kTissueCount; ++k) EXPECT_EQ(back.tissue[k], p.tissue[k]);
  Parameters odd = p;  // no number in µm converts to every double in mm
  for (double chip = 1e-4; chip < 1e-3; chip = std::nextafter(chip * 1.01, 1)) {
    odd.tissue[1].reference_chip = chip;
    EXPECT_EQ(parse_parameters(to_toml(odd), "p.toml").tissue[1].reference_chip, chip);
  }
}

TEST(Parameters, TheElementSizeIsReadBoundedAndSurvivesTheRoundTrip) {
  EXPECT_EQ(parse_parameters("", "p.toml").element_size, 0);  // as the bur's size asks for
  const Parameters p = parse_parameters("[engine]\nelement_mm = 0.02", "p.toml");
  EXPECT_EQ(p.element_size, 0.02);
  EXPECT_EQ(bits(parse_parameters(to_toml(p), "again")), bits(p));
  EXPECT_THAT(parse_error("[engine]\nelement_mm = 0.001"),
              HasSubstr("engine.element_mm: must be at least 0.005 mm"));
  EXPECT_THAT(parse_error("[engine]\nelement_mm = -1"), HasSubstr("engine.element_mm"));
}

TEST(Parameters, LiteralReadingsOfThePaperAreOptionsThatSurviveTheRoundTrip) {
  const Parameters p = parse_parameters(R"(
[handpiece]
stall_judged_on = "last_step"
[coupling]
attached_without_contact = true
[engine]
kind = "voxel"
trailing_elements = true
)",
                                        "p.toml");
  EXPECT_EQ(p.handpiece.stall_rule, StallRule::kLastStep);
  EXPECT_TRUE(p.coupling.attached_without_contact);
  EXPECT_TRUE(p.trailing_elements);
  EXPECT_EQ(bits(parse_parameters(to_toml(p), "again")), bits(p));
  EXPECT_THAT(parse_error("[engine]\ntrailing_elements = true"),
              HasSubstr("engine.trailing_elements: needs kind"));
  EXPECT_THAT(parse_error("[handpiece]\nstall_judged_on = 'last_step'\nmodel = 'droop'"),
              HasSubstr("handpiece.stall_judged_on"));
}

// Eq. 10: 0.4 mN.m/bar at 2.5 bar stalls at 1.0 mN.m.
TEST(Parameters, TheStallTorqueMayBeGivenAsPressureTimesCoefficient) {
  const char* given = "[handpiece]\npressure_bar = 2.5\nstall_coefficient_mnm_per_bar = 0.4\n";
  EXPECT_DOUBLE_EQ(parse_parameters(given, "p").handpiece.stall_torque, 1.0);
  EXPECT_THAT(parse_error(std::string(given) + "stall_torque_mnm = 1"),
              HasSubstr("handpiece.stall_torque_mnm: stands beside pressure_bar"));
  EXPECT_THAT(parse_error("[handpiece]\npressure_bar = 2.5"),
              HasSubstr("stall_coefficient_mnm_per_bar: is missing"));
  EXPECT_THAT(parse_error("[handpiece]\nstall_coefficient_mnm_per_bar = 1"),
              HasSubstr("pressure_bar: is missing"));
  EXPECT_THAT(parse_error("[handpiece]\nstall_coefficient_mnm_per_bar = 1\npressure_bar = -1"),
              HasSubstr("pressure_bar: must be positive"));
}

TEST(Parameters, AnUnknownKeyIsRefusedWithTheNearestKnownOne) {
  const std::vector<std::pair<std::string, std::string>> table = {
      {"presett = 'paper'", "'preset'"},
      {"[handpeice]\nclockwise = true", "'handpiece'"},
      {"[tissue.enamell]\nforce_ratio = 1", "'enamel'"},
      {"[tissue.enamel]\nforce_ration = 1", "'force_ratio'"},
      {"[tissue.enamel]\nspecific_energy = 1", "'specific_energy_j_per_mm3'"},
      {"[handpiece]\nstall_torque = 1", "'stall_torque_mnm'"},
      {"[coupling]\nstiffness = 1", "'stiffness_n_per_mm'"},
      {"[step]\ntimestep_s = 1", "'time_step_s'"},
      {"[engine]\nknd = 'voxel'", "'kind'"},
      // In the wrong table: the right one is named.
      {"stall_torque_mnm = 1", "'handpiece.stall_torque_mnm'"},
      {"[coupling]\nrotation_feed = true", "'step.rotation_feed'"}};
  for (const auto& [toml, nearest] : table) {
    EXPECT_THAT(parse_error(toml), HasSubstr("unknown key")) << toml;
    EXPECT_THAT(parse_error(toml), HasSubstr("did you mean " + nearest + "?")) << toml;
  }
}

TEST(Parameters, WhatCannotBeIsRefusedByName) {
  const std::vector<std::pair<std::string, std::string>> table = {
      {"preset = 'papr'", "preset: \"papr\" is not known"},
      {"preset = 3", "preset: must be a text"},
      {"tissue = 3", "tissue: must be a table"},
      {"[tissue]\nenamel = 0.3", "tissue.enamel: must be a table"},
      {"[tissue.enamel]\nforce_ratio = 0", "tissue.enamel.force_ratio: must be positive"},
      {"[tissue.enamel]\nforce_ratio = inf", "force_ratio: must be positive and finite"},
      {"[tissue.dentin]\nspecific_energy_j_per_mm3 = -1",
       "tissue.dentin.specific_energy_j_per_mm3"},
      {"[tissue.dentin]\nspecific_energy_j_per_mm3 = nan", "got nan"},
      {"[tissue.dentin]\nspecific_energy_j_per_mm3 = inf", "must be finite"},
      {"[tissue.dentin]\nspecific_energy_j_per_mm3 = '1'", "must be a number, not a text"},
      {"[handpiece]\nrotation_rate_rev_s = 0", "handpiece.rotation_rate_rev_s: must be positive"},
      {"[handpiece]\nstall_torque_mnm = 0", "handpiece.stall_torque_mnm: must be positive"},
      {"[handpiece]\nstall_torque_mnm = nan", "handpiece.stall_torque_mnm: must be positive"},
      {"[handpiece]\nstall_torque_mnm = -inf", "got -inf"},
      {"[handpiece]\nclockwise = 1", "handpiece.clockwise: must be true or false"},
      {"[handpiece]\ndroop_exponent = 0", "must be 0.5, 1, 1.5, ... or 8"},
      {"[handpiece]\ndroop_exponent = 1.2", "handpiece.droop_exponent"},
      {"[handpiece]\ndroop_exponent = 8.5", "handpiece.droop_exponent"},
      {"[handpiece]\ndroop_exponent = nan", "handpiece.droop_exponent"},
      {"[handpiece]\nrotor_inertia_g_mm2 = -1", "rotor_inertia_g_mm2: must be from 0.0 to 1e+06"},
      {"[handpiece]\nrotor_inertia_g_mm2 = inf", "handpiece.rotor_inertia_g_mm2"},
      {"[handpiece]\nrotor_inertia_g_mm2 = 10\nstall_torque_mnm = inf", "needs a finite stall"},
      {"[handpiece]\nrotor_inertia_g_mm2 = 10\nstall_judged_on = 'last_step'",
       "needs stall_judged"},
      {"[handpiece]\nrotor_inertia_g_mm2 = 10\nrun_down_s = nan", "handpiece.run_down_s"},
      {"[handpiece]\nrun_down_s = 1", "needs a rotor_inertia_g_mm2 above 0"},
      {"[handpiece]\nrotor_inertia_g_mm2 = 1\nrotor_inertia_t_mm2 = 1", "stands beside"},
      {"[tissue.enamel]\nsize_exponent = 1.0\nreference_chip_um = 1", "must be from -0.5 to 0.9"},
      {"[tissue.enamel]\nsize_exponent = nan\nreference_chip_um = 1", "must be from -0.5 to 0.9"},
      {"[tissue.enamel]\nsize_exponent = 0.5\nratio_exponent = 0.5\nreference_chip_um = 1",
       "tissue.enamel.ratio_exponent: added to size_exponent must be"},
      {"[tissue.dentin]\nsize_exponent = 0.3", "tissue.dentin.reference_chip_um: is missing"},
      {"[tissue.dentin]\nrubbing_pressure_n_per_mm2 = 1", "rubbing_pressure_n_per_mm2 refers to"},
      {"[tissue.dentin]\nrubbing_pressure_n_per_mm2 = -1",
       "rubbing_pressure_n_per_mm2: must be from 0.0 to"},
      {"[tissue.dentin]\nreference_chip_um = inf", "reference_chip_um: must be from"},
      {"[tissue.dentin]\nreference_chip_um = 1e-5", "reference_chip_um: must be from"},
      {"[tissue.dentin]\nreference_chip_um = -3.0", "got -3"},
      {"[tissue.dentin]\nrubbing_friction = 1e9", "rubbing_friction: must be from 0.0 to"},
      {"[tissue.dentin]\nrubbing_pressure_n_per_mm2 = nan", "got nan"},
      {"[tissue.dentin]\nup_cutting = -1", "up_cutting: must lie between -1 and 1"},
      {"[tissue.dentin]\nup_cutting = 0.2\n[engine]\nkind = 'voxel'\ntrailing_elements = true",
       "engine.trailing_elements: needs the paper's law"},
      {"[handpiece]\nmodel = 'drop'", "did you mean \"droop\""},
      {"[coupling]\nstiffness_n_per_mm = 0", "coupling.stiffness_n_per_mm"},
      {"[coupling]\ndamping_n_s_per_mm = -0.1", "coupling.damping_n_s_per_mm"},
      {"[coupling]\nbur_mass_g = 0", "coupling.bur_mass_g"},
      {"[load]\nmax_speed_mm_s = 0", "load.max_speed_mm_s: must be positive"},
      {"[load]\nrail = [0, 0, 0]", "load.rail: has no direction"},
      {"[load]\nrail = [0, 1]", "load.rail"},
      {"[step]\ntime_step_s = 0", "step.time_step_s: must be positive"},
      {"[step]\ntime_step_s = 0.11", "step.time_step_s: must be at most 0.1"},
      {"[engine]\nkind = 'octree'", "engine.kind"},
      {"[[handpiece]]\n", "handpiece: must be a table"},
      {"a = ", "line 1"},
      {"[step]\ntime_step_s = 1\ntime_step_s = 2", "line 3"},
      {std::string("\xff\xfe\0x", 4), "p.toml"}};
  for (const auto& [toml, part] : table) {
    EXPECT_THAT(parse_error(toml), HasSubstr(part)) << toml;
    EXPECT_THAT(parse_error(toml), HasSubstr("p.toml: ")) << toml;
  }
  EXPECT_EQ(parse_parameters("[step]\ntime_step_s = 0.1", "p").time_step, 0.1);
  EXPECT_THROW(static_cast<void>(read_parameters("no/such.toml")), InputError);
  EXPECT_THROW(static_cast<void>(read_parameters(::testing::TempDir())), InputError);
}

TEST(Parameters, ValidateNamesTheKeyOfTheFirstViolation) {
  Parameters p = preset_parameters("paper");
  EXPECT_NO_THROW(validate(p));
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  p.tissue[1].specific_energy = 0;
  EXPECT_NO_THROW(validate(p));
  p.coupling.bur_mass = -1;
  EXPECT_THAT(error_of([&] { validate(p); }), HasSubstr("coupling.bur_mass_g"));
}

TEST(Parameters, TheTextOfAPresetIsReadBackBitForBit) {
  for (const char* name : kPresets) {
    const Parameters p = preset_parameters(name);
    EXPECT_EQ(bits(parse_parameters(to_toml(p), "p")), bits(p));
  }
  EXPECT_THAT(to_toml(preset_parameters("physical")), HasSubstr("uncalibrated"));
  EXPECT_THAT(to_toml(preset_parameters("paper")), HasSubstr("specific_energy_j_per_mm3 = 0.3\n"));
  EXPECT_THAT(to_toml(preset_parameters("paper")), HasSubstr("bur_mass_g = 8.0\n"));
}

// Also values that no number in the file's unit converts to: with mantissas just below 2, about
// half of the doubles are 1000 times no other double.
TEST(Parameters, AnyParametersAreReadBackBitForBit) {
  std::mt19937_64 random(7);
  const auto any = [&] {
    return std::ldexp(1.0 + std::generate_canonical<double, 53>(random),
                      static_cast<int>(random() % 40) - 20);
  };
  int written_directly = 0;
  for (int i = 0; i < 500; ++i) {
    Parameters p = preset_parameters(i % 2 ? "paper" : "physical");
    for (auto& t : p.tissue) t = {any(), any()};
    p.tissue[0].specific_energy = 1.99 * std::ldexp(1.0, i % 9) + 1e-13 * i;
    p.handpiece = {any(), i % 5 ? any() : std::numeric_limits<double>::infinity(), i % 3 == 0,
                   i % 7 ? HandpieceModel::kDroop : HandpieceModel::kFixed};
    p.handpiece.droop_exponent = 0.5 * (1 + i % 16);
    if (i % 5 && i % 3) p.handpiece.rotor_inertia = any() * 1e-7, p.handpiece.run_down = i % 2;
    p.coupling = {any(), i % 4 ? any() : 0.0, any() * 1e-6};
    p.time_step = std::ldexp(any(), -25);
    p.engine = i % 2 ? EngineKind::kVoxel : EngineKind::kLevelset;
    p.rotation_feed = i % 3 == 1;
    const std::string text = to_toml(p);
    written_directly += text.find("n_per_mm2") != std::string::npos;
    ASSERT_EQ(bits(parse_parameters(text, "p")), bits(p)) << text;
  }
  EXPECT_GT(written_directly, 0);  // else this test misses the hard case
}

TEST(Parameters, BothUnitsOfOneValueAreRefused) {
  EXPECT_THAT(
      parse_error("[tissue.pulp]\nspecific_energy_j_per_mm3=1\nspecific_energy_n_per_mm2=1"),
      HasSubstr("stands beside"));
}

TEST(NearestName, CountsInsertionsDeletionsAndSubstitutions) {
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);  // the textbook's example
  EXPECT_EQ(edit_distance("", "abc"), 3u);
  EXPECT_EQ(edit_distance("same", "same"), 0u);
  EXPECT_EQ(nearest_name("enamle", {"dentin", "enamel", "pulp"}), "enamel");
  EXPECT_EQ(nearest_name("x", {}), "");
}

}  // namespace
}  // namespace toothprep
