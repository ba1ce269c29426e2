#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/child_process.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;

bool is_running(pid_t pid) { return kill(pid, 0) == 0; }

bool ends_within_10_s(pid_t pid) {
  for (int k = 0; k < 1000 && is_running(pid); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  return !is_running(pid);
}

TEST(ChildProcess, GivesTheExitStatusOrTheSignal) {
  EXPECT_TRUE(ChildProcess({"/bin/sh", "-c", "exit 0"}).wait().good());
  const ChildEnd three = ChildProcess({"/bin/sh", "-c", "exit 3"}).wait();
  EXPECT_TRUE(three.exited);
  EXPECT_EQ(three.code, 3);
  const ChildEnd killed = ChildProcess({"/bin/sh", "-c", "kill -SEGV $$"}).wait();
  EXPECT_FALSE(killed.exited);
  EXPECT_EQ(killed.code, SIGSEGV);
}

TEST(ChildProcess, AProgramThatIsNotThereIsAnErrorThatNamesIt) {
  try {
    ChildProcess({"/no/such/program"});
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("/no/such/program: cannot be started: No such file"),
              std::string::npos)
        << e.what();
  }
}

// A process that starts a child and is killed outright: the child does not live on.
TEST(ChildProcess, DoesNotOutliveAParentThatIsKilled) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t parent = fork();
  if (parent == 0) {
    ChildOptions options;
    options.own_group = true;
    options.stdout_file = options.stderr_file = "/dev/null";
    ChildProcess child(
        {"/bin/sh", "-c", "echo $$ >&" + std::to_string(ends[1]) + "; exec sleep 60"}, options);
    child.wait();
    _exit(0);
  }
  std::string text;
  char c = 0;
  while (::read(ends[0], &c, 1) == 1 && c != '\n') text += c;
  const pid_t child = std::stoi(text);
  EXPECT_TRUE(is_running(child));
  kill(parent, SIGKILL);
  waitpid(parent, nullptr, 0);
  EXPECT_TRUE(ends_within_10_s(child));
  close(ends[0]);
  close(ends[1]);
}

}  // namespace
}  // namespace toothprep
