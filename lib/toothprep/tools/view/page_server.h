// Serves a page and its data to browsers on this machine, over HTTP and WebSocket.
//
// What keeps others out:
//   address   bound to the loopback address unless another is asked for; every path begins with a
//             random token of 128 bits, without which nothing is answered but 403
//   Host      must be this address, so that a foreign name that resolves to it (DNS rebinding) is
//             refused; Origin, where a browser sends one, must be the page's own, and a WebSocket
//             needs it
//   paths     looked up by what get() knows; no path is ever that of a file
//   policy    a strict Content-Security-Policy: scripts, styles and connections of this server only
//   load      requests have a header of at most 8 kB and no body; messages of a page at most 1 kB
//             and read at 50 Hz; so many connections and no more; whoever sends or reads nothing is dropped
//
// One thread serves all. A feed's messages are asked for when the last one has gone out: whoever
// reads slowly gets the newest state, not a queue.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace toothprep {

struct PageAnswer {
  std::string type;  // media type
  std::string body;
};

// What one page is sent while it stays connected.
class PageFeed {
 public:
  virtual ~PageFeed() = default;
  // The next binary message, empty if there is nothing new; asked for 60 times a second at most.
  virtual std::string next() = 0;
  // A message of the page, of at most 1 kB and 50 a second; others wait in the network.
  virtual void hear(std::string_view message) { static_cast<void>(message); }
};

// What there is to be had. All of it is called on the server's thread.
class PageSource {
 public:
  virtual ~PageSource() = default;
  // `path` is what follows the token and its slash, e.g. "page.css"; `query` what follows the '?'.
  // Empty: there is no such thing.
  virtual std::optional<PageAnswer> get(std::string_view path, std::string_view query) = 0;
  // Of a page that connects to "feed"; null: there is none.
  virtual std::unique_ptr<PageFeed> feed() { return nullptr; }
};

struct PageServerSettings {
  std::string bind = "127.0.0.1";  // an address of this machine, IPv4 or IPv6
  unsigned short port = 0;         // 0: any that is free
  std::size_t most_connections = 64;
};

class PageServer {
 public:
  // Listens from now on. `source` must outlive it. Throws Error naming the address if it can't.
  PageServer(const PageServerSettings& settings, PageSource& source);
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;

  [[nodiscard]] std::string address() const;  // with the token: whoever has it may look

  // Serves until SIGINT, SIGTERM or SIGHUP. `ready` is called once these end it in order: only then
  // should anybody learn the address.
  void run_until_signal(const std::function<void()>& ready);
  // Serves on a thread of its own until the end of this object, after all others of the machine
  // have what they need. Not from a real-time thread, whose scheduling it would inherit.
  void start();

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace toothprep
