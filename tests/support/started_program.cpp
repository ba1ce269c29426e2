// Preloaded into the program (LD_PRELOAD), this stops it once its libraries are loaded and relocated, before anything of them
// is initialized, and lets a child process go on from there for each request of started_program.py. Looking up 90 000 symbols
// of a hundred libraries is most of what a short command takes.
#include <dlfcn.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace {

constexpr const char* kSocket = "TOOTHPREP_TEST_SOCKET=";

using Descriptors = std::array<int, 3>;  // stdin, stdout, stderr

struct Ended {
  int status = -1;
  rusage used{};
};

// What the child runs: the folder, the program's name and its arguments, each with a zero byte behind it. Not on the heap:
// nothing is initialized yet.
std::array<char, 1 << 17> request;
std::array<char*, 1 << 12> words;
int word_count = 0;

// The socket's number, or -1; what belongs to the tests is taken from the environment.
int take_socket(char** environment) {
  int socket = -1;
  char** kept = environment;
  for (char** one = environment; *one != nullptr; ++one) {
    if (std::strncmp(*one, kSocket, std::strlen(kSocket)) == 0)
      socket = std::atoi(*one + std::strlen(kSocket));
    else if (std::strncmp(*one, "LD_PRELOAD=", 11) != 0)
      *kept++ = *one;
  }
  *kept = nullptr;
  return socket;
}

// The next request's size and its descriptors; ends the process if none comes.
std::size_t receive(int socket, Descriptors& standard) {
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(Descriptors))> space{};
  iovec text{request.data(), request.size()};
  msghdr message{};
  message.msg_iov = &text;
  message.msg_iovlen = 1;
  message.msg_control = space.data();
  message.msg_controllen = space.size();
  const ssize_t size = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
  const cmsghdr* control = size > 0 ? CMSG_FIRSTHDR(&message) : nullptr;
  if (control == nullptr || control->cmsg_len != CMSG_LEN(sizeof standard)) _exit(0);
  std::memcpy(standard.data(), CMSG_DATA(control), sizeof standard);
  return static_cast<std::size_t>(size);
}

// In the child: its folder, descriptors and words.
void take_place(int socket, std::size_t size, const Descriptors& standard) {
  for (std::size_t at = 0; at < size && word_count + 1 < static_cast<int>(words.size());
       at += std::strlen(&request[at]) + 1)
    words[static_cast<std::size_t>(word_count++)] = &request[at];
  for (int i = 0; i < static_cast<int>(standard.size()); ++i)
    if (dup2(standard[static_cast<std::size_t>(i)], i) < 0) _exit(127);
  for (const int file : standard) close(file);
  close(socket);
  if (chdir(words.front()) != 0) _exit(127);
}

// Before the constructors of all other libraries (-z initfirst). Returns in children only.
__attribute__((constructor)) void serve(int, char**, char** environment) {
  const int socket = take_socket(environment);
  if (socket < 0) return;
  for (;;) {
    Descriptors standard{};
    const std::size_t size = receive(socket, standard);
    const pid_t child = fork();
    if (child == 0) return take_place(socket, size, standard);
    for (const int file : standard) close(file);
    Ended ended;
    static_cast<void>(send(socket, &child, sizeof child, MSG_NOSIGNAL));
    while (child > 0 && wait4(child, &ended.status, 0, &ended.used) < 0 && errno == EINTR) {
    }
    static_cast<void>(send(socket, &ended, sizeof ended, MSG_NOSIGNAL));
  }
}

}  // namespace

// libc's, which calls main(): with the request's arguments.
extern "C" int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv,
                                 void (*init)(), void (*fini)(), void (*loader_fini)(),
                                 void* stack_end) {
  const auto start =
      reinterpret_cast<decltype(&__libc_start_main)>(dlsym(RTLD_NEXT, "__libc_start_main"));
  if (word_count > 0) argc = word_count - 1, argv = words.data() + 1;
  return start(main, argc, argv, init, fini, loader_fini, stack_end);
}
