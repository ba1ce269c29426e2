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

// ---- By a starter

ChildOptions by(ChildStarter& starter) {
  ChildOptions options;
  options.own_group = true;
  options.stdout_file = options.stderr_file = "/dev/null";
  options.starter = &starter;
  return options;
}

TEST(ChildStarter, ItsChildrenAreTheProgramsOwn) {
  const pid_t self = getpid();
  ChildStarter starter([self](const std::vector<std::string>& arguments) {
    if (getppid() != self) return 1;
    if (arguments.back() == "die") raise(SIGKILL);
    return std::stoi(arguments.back());
  });
  for (const int status : {0, 3}) {
    const ChildEnd end = ChildProcess({"x", std::to_string(status)}, by(starter)).wait();
    EXPECT_TRUE(end.exited);
    EXPECT_EQ(end.code, status);
  }
  const ChildEnd killed = ChildProcess({"x", "die"}, by(starter)).wait();
  EXPECT_FALSE(killed.exited);
  EXPECT_EQ(killed.code, SIGKILL);
  const std::string lengthy(300'000, 'a');  // more than a socket takes at once
  EXPECT_TRUE(ChildProcess({"x", lengthy, "0"}, by(starter)).wait().good());
}

TEST(ChildStarter, OutlivesTheSignalsThatEndAClustersJob) {
  ChildStarter starter([](const std::vector<std::string>&) { return raise(SIGTERM); });
  pid_t process = 0;  // the only child until now
  std::ifstream("/proc/thread-self/children") >> process;
  ASSERT_GT(process, 0);
  for (const int s : {SIGTERM, SIGINT, SIGHUP}) kill(process, s);
  const ChildEnd end = ChildProcess({"x"}, by(starter)).wait();
  EXPECT_FALSE(end.exited);
  EXPECT_EQ(end.code, SIGTERM);  // which its children take
}

TEST(ChildStarter, AChildThatCannotStartIsAnErrorAndTheNextOneStarts) {
  ChildStarter starter([](const std::vector<std::string>&) { return 0; });
  ChildOptions nowhere = by(starter);
  nowhere.folder = "/no/such/folder";
  EXPECT_THROW(ChildProcess({"x"}, nowhere), Error);
  EXPECT_TRUE(ChildProcess({"x"}, by(starter)).wait().good());
}

// What the program took after the starter was made is not copied to its children.
TEST(ChildStarter, ChildrenStayAsSmallAsTheProgramWas) {
  ChildStarter starter([](const std::vector<std::string>&) { return 0; });
  constexpr std::size_t kGrown = 300u << 20;
  const std::vector<char> grown(kGrown, 1);
  const std::uint64_t by_starter = ChildProcess({"x"}, by(starter)).wait().memory;
  EXPECT_EQ(grown[kGrown / 2], 1);
  EXPECT_LT(by_starter, kGrown / 2);
}

TEST(ChildStarter, ItsChildrenDoNotOutliveAProgramThatIsKilled) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t parent = fork();
  if (parent == 0) {
    ChildStarter starter([&ends](const std::vector<std::string>&) {
      const pid_t self = getpid();
      if (write(ends[1], &self, sizeof self) != sizeof self) return 1;
      for (;;) pause();
    });
    ChildProcess child({"x"}, by(starter));
    child.wait();
    _exit(0);
  }
  pid_t child = 0;
  ASSERT_EQ(::read(ends[0], &child, sizeof child), static_cast<ssize_t>(sizeof child));
  EXPECT_TRUE(is_running(child));
  kill(parent, SIGKILL);
  waitpid(parent, nullptr, 0);
  EXPECT_TRUE(ends_within_10_s(child));
  close(ends[0]);
  close(ends[1]);
}

}  // namespace
}  // namespace toothprep
