// Claims of items by processes that share a folder.
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>

#include "scratch_folder.h"
#include "toothprep/tools/batch/claims.h"
#include "toothprep/tools/io/process_name.h"

namespace toothprep {
namespace {

using Answer = Claims::Answer;

class ItemClaims : public ScratchFolder {
 protected:
  Claims claims(const ClaimOwner& owner, bool others_ended = false) const {
    return {folder_, owner, [others_ended](const ClaimOwner&) { return others_ended; }};
  }
  // The name of a process of this machine that has ended.
  static std::string ended_process() {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) {
      const std::string name = process_name();
      _exit(write(ends[1], name.data(), name.size()) > 0 ? 0 : 1);
    }
    waitpid(child, nullptr, 0);
    std::string name(100, '\0');
    name.resize(static_cast<std::size_t>(read(ends[0], name.data(), name.size())));
    close(ends[0]);
    close(ends[1]);
    return name;
  }
  static constexpr const char* kElsewhere = "00000000-00000000-7-7";
};

TEST_F(ItemClaims, OneProcessHoldsAnItemUntilItReleasesIt) {
  Claims first = claims({process_name(), "", 0}), second = claims({kElsewhere, "", 0});
  EXPECT_EQ(first.take("a"), Answer::kMine);
  EXPECT_EQ(first.take("a"), Answer::kMine);
  EXPECT_EQ(second.take("a"), Answer::kHeld);
  EXPECT_EQ(second.take("b"), Answer::kMine);
  EXPECT_TRUE(second.held("a"));
  first.release("a");
  EXPECT_FALSE(second.held("a"));
  EXPECT_EQ(second.take("a"), Answer::kMine);
}

TEST_F(ItemClaims, TheItemOfAProcessThatEndedIsTakenByOneOther) {
  Claims dead = claims({ended_process(), "", 0});
  EXPECT_EQ(dead.take("a"), Answer::kMine);
  Claims first = claims({process_name(), "", 0}), second = claims({kElsewhere, "", 0});
  EXPECT_EQ(first.take("a"), Answer::kMine);
  EXPECT_EQ(second.take("a"), Answer::kHeld);
  first.release("a");
  EXPECT_EQ(second.take("a"), Answer::kMine);
}

TEST_F(ItemClaims, OfAnotherMachineTheSchedulerIsAsked) {
  Claims far = claims({kElsewhere, "12", 0});
  EXPECT_EQ(far.take("a"), Answer::kMine);
  EXPECT_EQ(claims({process_name(), "13", 0}, false).take("a"), Answer::kHeld);
  EXPECT_EQ(claims({process_name(), "13", 0}, true).take("a"), Answer::kMine);
}

TEST_F(ItemClaims, AJobThatWasBegunAnewTakesWhatItsFormerRunHeld) {
  Claims far = claims({kElsewhere, "12", 0});
  EXPECT_EQ(far.take("a"), Answer::kMine);
  EXPECT_EQ(claims({process_name(), "12", 1}).take("a"), Answer::kMine);
}

TEST_F(ItemClaims, OfManyAtOnceOneWins) {
  Claims dead = claims({ended_process(), "", 0});
  dead.take("a");
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  std::vector<pid_t> children;
  for (int k = 0; k < 8; ++k) {
    const pid_t child = fork();
    if (child == 0) {
      Claims own = claims({process_name(), "", 0});
      const bool mine = own.take("a") == Answer::kMine;
      if (mine && write(ends[1], "x", 1) != 1) _exit(1);
      pause();  // an owner that ended would lose it
    }
    children.push_back(child);
  }
  usleep(300'000);
  for (const pid_t child : children) kill(child, SIGKILL);
  for (const pid_t child : children) waitpid(child, nullptr, 0);
  close(ends[1]);
  char wins[9];
  EXPECT_EQ(read(ends[0], wins, sizeof wins), 1);
  close(ends[0]);
}

}  // namespace
}  // namespace toothprep
