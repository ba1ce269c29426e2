// simulator TOOTH.vdb PATH.csv BUR TRACE.h5: a tooth in a 1 kHz loop of one's own, each step within a budget.
#include <toothprep/step/bur/bur_library.h>
#include <toothprep/step/core/errors.h>
#include <toothprep/step/session/session.h>
#include <toothprep/tools/files/tooth_file.h>
#include <toothprep/tools/files/trace.h>
#include <toothprep/tools/trajectory/trajectory.h>

#include <chrono>
#include <cstdio>
#include <thread>

using namespace toothprep;
using Clock = std::chrono::steady_clock;
constexpr auto kPeriod = std::chrono::microseconds(1000), kBudget = std::chrono::microseconds(500);

int main(int argc, char** argv) try {
  if (argc != 5) throw Error("usage: simulator TOOTH.vdb PATH.csv BUR TRACE.h5");
  const LayeredTooth tooth = read_tooth(argv[1]);
  const Bur bur = make_bur(argv[3], DATA_FOLDER "/burs");
  const Parameters parameters = preset_parameters("paper");
  const auto hand = resample(read_csv_trajectory(argv[2]), parameters.time_step, false, argv[2]);

  Workpiece workpiece(tooth);  // what is ground; the tooth stays as it is
  Session session(bur, workpiece, parameters, Drive::kCoupled, hand.front());
  Trace trace;
  trace.rows.reserve(hand.size());
  trace.rows.push_back(session.initial());
  long late = 0;
  auto tick = Clock::now();
  for (std::size_t i = 1; i < hand.size(); ++i) {
    std::this_thread::sleep_until(tick += kPeriod);
    const auto start = Clock::now();
    trace.rows.push_back(session.step(hand[i]));  // its device_force is what the hand feels
    late += Clock::now() - start > kBudget;
  }
  session.finish(trace.rows.back());
  write_trace(trace, argv[4]);
  std::printf("%zu steps, %ld of them above the budget; peak force %.3f N\n", hand.size() - 1, late,
              session.totals().peak_device_force);
} catch (const InputError& e) {  // the parts of the message, for a program's own dialogue
  std::fprintf(stderr, "file %s, place %s: %s (%s)\n", e.file().c_str(), e.place().c_str(),
               e.condition().c_str(), e.remedy().c_str());
  return 1;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
