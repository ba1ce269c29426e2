// The same bits on every processor: a session in a process whose C library may not use fused
// multiply-add or AVX2 gives what it gives in this one. (The distance kernels are compared in
// tests/step/bur/test_distance.cpp; everything else is compiled once, for the oldest processor.)
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "experiment.h"

namespace toothprep::testing {
namespace {

// FNV-1a over the bits of forces, torques, poses and volumes of sessions that turn, lean, stall and go in parts, and of
// one that goes straight beside what it took before.
std::uint64_t hash_of_a_session() {
  const Bur bur = make_bur("cone:D1.6xL4.0xT1.2xR0.3", "");
  const LayeredTooth tooth = block(0.1, 0.6, Vec3(4, 3, 4));
  std::uint64_t hash = 14695981039346656037u;
  const auto include = [&hash](double x) {
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    for (int i = 0; i < 8; ++i) hash = (hash ^ (bits >> 8 * i & 0xff)) * 1099511628211u;
  };
  Parameters bent = preset_parameters("paper");
  for (GrindingProperties& t : bent.tissue) {
    t.size_exponent = 0.31, t.ratio_exponent = 0.17, t.reference_chip = 3e-3;
    t.rubbing_pressure = 0.2, t.up_cutting = 0.3;
  }
  using Settings = std::pair<Drive, Parameters>;
  for (const auto& [drive, parameters] :
       {Settings{Drive::kDirect, preset_parameters("paper")},
        Settings{Drive::kCoupled, preset_parameters("paper")}, Settings{Drive::kCoupled, bent}}) {
    const auto handle = [](int i) {
      // Polynomials and roots only: what comes in must not depend on the C library.
      const double t = i * 1e-3, wave = 4 * t * (0.8 - t);
      const Quat lean = Quat(0.8, -0.6 + 0.1 * wave, 0.15 * t, 0.02).normalized();
      return HandleSample{t, Pose{Vec3(-1 + 2.5 * t, 0.3 - 1.5 * t, 0.3 * wave), lean},
                          kPedalButton};
    };
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, parameters, drive, handle(0));
    for (int i = 1; i < 800; ++i) {
      const StepRecord row = session.step(handle(i));
      for (int a = 0; a < 3; ++a)
        include(row.grinding_force[a]), include(row.device_force[a]), include(row.bur.position[a]);
      include(row.torque), include(row.removed_volume[0]), include(row.removed_volume[1]);
    }
  }
  Workpiece workpiece(tooth);
  const Quat lean = Quat(0.8, -0.6, 0.1, 0.02).normalized();
  HandleSample handle{0, Pose{Vec3(-2, -0.2, 0), lean}, kPedalButton};
  Session session(bur, workpiece, preset_parameters("paper"), Drive::kDirect, handle);
  for (int pass = 0; pass < 3; ++pass)
    for (int i = 0; i <= 500; ++i) {
      handle.time += 1e-3;
      const double way = pass % 2 ? 500 - i : i;
      handle.pose.position = Vec3(-2 + 8e-3 * way, -0.2 - 0.05 * pass, 0.2 * pass);
      const StepRecord row = session.step(handle);
      for (int a = 0; a < 3; ++a) include(row.grinding_force[a]);
      include(row.torque);
    }
  return hash;
}

TEST(SameBits, DISABLED_Print) {
  std::printf("hash %016llx\n", static_cast<unsigned long long>(hash_of_a_session()));
}

#if defined(__linux__) && defined(__x86_64__)
TEST(SameBits, WithoutFusedMultiplyAddAndAvx2InTheCLibrary) {
  char here[64], line[256];
  std::string there;
  std::snprintf(here, sizeof here, "hash %016llx\n",
                static_cast<unsigned long long>(hash_of_a_session()));
  char self[4096] = "";
  FILE* link = popen("readlink /proc/$PPID/exe", "r");
  ASSERT_TRUE(link && std::fgets(self, sizeof self, link));
  pclose(link);
  self[std::strcspn(self, "\n")] = 0;
  // The names before and since glibc 2.33.
  const std::string command =
      "GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2_Usable,-FMA_Usable,-FMA4_Usable,-AVX2,-FMA,-FMA4 '" +
      std::string(self) +
      "' --gtest_also_run_disabled_tests --gtest_filter=SameBits.DISABLED_Print";
  FILE* child = popen(command.c_str(), "r");
  ASSERT_TRUE(child);
  while (std::fgets(line, sizeof line, child))
    if (std::strncmp(line, "hash ", 5) == 0) there = line;
  pclose(child);
  EXPECT_EQ(here, there);
}
#endif

}  // namespace
}  // namespace toothprep::testing
