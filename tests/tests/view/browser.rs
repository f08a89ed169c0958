//! A page in headless Chromium, and what a script in it reports.
//!
//! The page comes from a server of this process. The script has `files` (what else that serves, by name, as
//! bytes) and `report(object)`, with which it ends.

use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How long a page may take before it counts as hung, on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// What of the console is Chromium's own, about drawing without a graphics card.
const OF_CHROMIUM: [&str; 2] = ["GPU stall due to ReadPixels", "fallback to software WebGL"];

/// Runs before the page's scripts.
const PROLOGUE: &str = "
const complaints = [];
addEventListener('error', event => complaints.push(event.message));
addEventListener('unhandledrejection', event => complaints.push(String(event.reason)));
const files = async name => {
  const answer = await fetch('file/' + name);
  if (!answer.ok) throw Error(`${answer.status}: ${name}`);
  return new Uint8Array(await answer.arrayBuffer());
};
// What a canvas shows can be read at any time.
const { getContext } = HTMLCanvasElement.prototype;
HTMLCanvasElement.prototype.getContext = function (kind, options) { return getContext.call(this, kind, { ...options, preserveDrawingBuffer: true }); };
const report = object => fetch('report', { method: 'POST', body: JSON.stringify({ ...object, complaints }) });
";

/// The browser: that of `NDGI_CHROMIUM`, which must run, or else `chromium`, without which the tests say that
/// they were skipped.
pub fn chromium() -> Option<String> {
    let named = std::env::var("NDGI_CHROMIUM").ok();
    let browser = named.clone().unwrap_or("chromium".to_owned());
    let works = Command::new(&browser).arg("--version").output().is_ok_and(|output| output.status.success());
    assert!(works || named.is_none(), "NDGI_CHROMIUM={browser} does not run");
    if !works {
        eprintln!("skipped: there is no chromium");
    }
    works.then_some(browser)
}

/// Ends the browser however the test ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What `script` reports of a page. Panics on errors of the page's scripts, anything on the console, and
/// where nothing is reported.
pub fn run(browser: &str, html: &str, hash: &str, files: BTreeMap<String, Vec<u8>>, script: &str) -> Value {
    let html = html.replacen("<head>", &format!("<head><script>{PROLOGUE}</script>"), 1).replacen(
        "</body>",
        &format!("<script>{script}</script></body>"),
        1,
    );
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/{hash}", listener.local_addr().unwrap());
    let (reports, reported) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (html, files, reports) = (html.clone(), files.clone(), reports.clone());
            std::thread::spawn(move || answer(stream, &html, &files, &reports));
        }
    });
    let profile = tempfile::tempdir().unwrap();
    let folder = format!("--user-data-dir={}", profile.path().display());
    let quick = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-unsafe-swiftshader",
        "--enable-logging=stderr",
    ];
    let child = Command::new(browser)
        .args(quick)
        .args(["--window-size=800,600", "--no-first-run", &folder, &url])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut running = Running(child);
    let log = running.0.stderr.take().unwrap();
    let console = Arc::new(Mutex::new(Vec::new()));
    let lines = Arc::clone(&console);
    std::thread::spawn(move || {
        for line in BufReader::new(log).lines().map_while(Result::ok) {
            if line.contains("CONSOLE") && !OF_CHROMIUM.iter().any(|own| line.contains(own)) {
                lines.lock().unwrap().push(line);
            }
        }
    });
    let report = reported.recv_timeout(PATIENCE);
    // Before the browser ends: what it complains of then is no fault of the page.
    let console = console.lock().unwrap().clone();
    drop(running);
    let report: Value =
        report.unwrap_or_else(|_| panic!("the page reports nothing; its console: {console:#?}"));
    assert_eq!(report["complaints"], serde_json::json!([]), "{report:#}");
    assert!(console.is_empty(), "on the console: {console:#?}; reported: {report:#}");
    report
}

/// A script has to say that it is one.
fn kind_of(path: &str) -> &'static str {
    if path.ends_with(".js") { "text/javascript" } else { "application/octet-stream" }
}

/// Answers one request.
fn answer(stream: TcpStream, html: &str, files: &BTreeMap<String, Vec<u8>>, reports: &Sender<Value>) {
    let mut lines = BufReader::new(stream.try_clone().unwrap());
    let (mut first, mut length) = (String::new(), 0);
    if lines.read_line(&mut first).unwrap_or(0) == 0 {
        return;
    }
    loop {
        let mut line = String::new();
        if lines.read_line(&mut line).unwrap_or(0) == 0 || line.trim().is_empty() {
            break;
        }
        if let Some(n) = line.to_ascii_lowercase().strip_prefix("content-length:") {
            length = n.trim().parse().unwrap_or(0);
        }
    }
    let path = first.split(' ').nth(1).unwrap_or("");
    if path == "/report" {
        let mut body = vec![0; length];
        lines.read_exact(&mut body).unwrap();
        reports.send(serde_json::from_slice(&body).unwrap()).ok();
    }
    let body = match path {
        "/" => Some((html.as_bytes(), "text/html; charset=utf-8")),
        "/report" => Some((&b""[..], "text/plain")),
        _ => path
            .strip_prefix("/file/")
            .and_then(|name| files.get(name))
            .map(|bytes| (&bytes[..], kind_of(path))),
    };
    let (status, (bytes, kind)) =
        body.map_or(("404 Not Found", (&b""[..], "text/plain")), |body| ("200 OK", body));
    let mut out = stream;
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        bytes.len()
    );
    let _ = out.write_all(head.as_bytes()).and_then(|()| out.write_all(bytes));
}
