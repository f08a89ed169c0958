//! The page and its data over HTTP, on this machine alone.

use super::{Source, shell_of_server};
use crate::{Error, Result};
use dataset::host::signals::interrupted;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The longest line of a request, and how many there may be.
const MOST_LINE: u64 = 8192;
const MOST_LINES: usize = 100;
/// How long a request may take to arrive, and its answer to begin to leave …
const PATIENCE: Duration = Duration::from_secs(10);
/// … with a second more for this many bytes of the answer that were taken.
const SLOWEST: f64 = (1 << 18) as f64;
/// Connections at once; a browser opens six. Others wait until one of these ends.
const MOST_CONNECTIONS: usize = 32;
/// How often an interrupt is looked for.
const PAUSE: Duration = Duration::from_millis(20);

/// A port that is taken, on the loopback interface.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
}

impl Server {
    /// Takes a port; 0 is any free one.
    ///
    /// # Errors
    /// A port that is not free.
    pub fn bind(port: u16) -> Result<Self> {
        let place = format!("127.0.0.1:{port}");
        let taken = |error: io::Error| {
            let what = format!("{place}: {error}; expected a free port, or 0 for any");
            match error.kind() {
                // Whoever has it may end.
                io::ErrorKind::AddrInUse => Error::unready("--serve", what),
                _ => Error::invalid("--serve", what),
            }
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        Ok(Server { listener, address })
    }

    /// Where the page is.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }
}

/// Answers requests until the process is interrupted.
///
/// # Errors
/// [`Error::Interrupted`], which is how it is to end; a port that cannot be used.
pub fn serve(server: &Server, source: Source) -> Result<()> {
    let source = Arc::new(source);
    server.listener.set_nonblocking(true).map_err(Error::io("--serve".as_ref()))?;
    let open = Arc::new(AtomicUsize::new(0));
    while !interrupted() {
        let is_free = open.load(Ordering::Acquire) < MOST_CONNECTIONS;
        match is_free.then(|| server.listener.accept()) {
            // What a browser breaks off is no fault of this program.
            Some(Ok((stream, _))) => {
                let source = Arc::clone(&source);
                begin(
                    stream,
                    &open,
                    move |stream| answer(stream, &source),
                    |work| std::thread::Builder::new().spawn(work).map(drop),
                );
            }
            _ => std::thread::sleep(PAUSE),
        }
    }
    Err(Error::Interrupted)
}

/// Answers a connection on a thread of its own, by `spawn`, and counts it as open meanwhile. Where the system
/// has no thread left, the client is told to come again.
fn begin(
    stream: TcpStream,
    open: &Arc<AtomicUsize>,
    answer: impl FnOnce(TcpStream) -> io::Result<()> + Send + 'static,
    spawn: impl FnOnce(Box<dyn FnOnce() + Send>) -> io::Result<()>,
) {
    /// One open connection, until it is dropped.
    struct Open(Arc<AtomicUsize>);
    impl Drop for Open {
        fn drop(&mut self) {
            self.0.fetch_sub(1, Ordering::AcqRel);
        }
    }
    open.fetch_add(1, Ordering::AcqRel);
    let counted = Open(Arc::clone(open));
    let other = stream.try_clone();
    let work = move || {
        let _counted = counted;
        let _ = answer(stream);
    };
    if spawn(Box::new(work)).is_err()
        && let Ok(mut stream) = other
    {
        // (What fits into an empty buffer is sent without waiting.)
        let _ = refuse(&mut stream, "503 Service Unavailable\r\nRetry-After: 1");
    }
}

/// A connection that fails with [`io::ErrorKind::TimedOut`] after a time, however its client deals out bytes.
struct Timed {
    stream: TcpStream,
    until: Instant,
}

impl Timed {
    fn new(stream: TcpStream) -> Self {
        Timed { stream, until: Instant::now() + PATIENCE }
    }

    fn left(&self) -> io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(left) }
    }
}

impl Read for Timed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(buffer)
    }
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        let written = self.stream.write(bytes)?;
        self.until += Duration::from_secs_f64(written as f64 / SLOWEST);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// A request: its method, path, and the range of bytes asked for.
struct Request {
    method: String,
    path: String,
    range: Option<String>,
    host: String,
}

fn answer(stream: TcpStream, source: &Source) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    let from = Timed::new(stream.try_clone()?);
    let Some(request) = read_request(&mut BufReader::new(from))? else { return Ok(()) };
    let mut out = Timed::new(stream);
    let is_head = request.method == "HEAD";
    // Refuse other host names (DNS rebinding): a foreign page could read this server.
    let host = request.host.rsplit_once(':').map_or(&*request.host, |(host, _)| host);
    if !["127.0.0.1", "localhost"].contains(&host) {
        return refuse(&mut out, "403 Forbidden");
    }
    if !is_head && request.method != "GET" {
        return refuse(&mut out, "405 Method Not Allowed");
    }
    if request.path == "/" {
        return send(&mut out, is_head, "text/html; charset=utf-8", shell_of_server(source).into_bytes());
    }
    let Some(name) = request.path.strip_prefix("/data/") else { return refuse(&mut out, "404 Not Found") };
    match source.file(name) {
        Some(path) => send_file(&mut out, is_head, File::open(path)?, request.range.as_deref()),
        None => match source.read(name) {
            Ok(bytes) => send(&mut out, is_head, "application/octet-stream", bytes),
            Err(_) => refuse(&mut out, "404 Not Found"),
        },
    }
}

fn read_request(from: &mut impl BufRead) -> io::Result<Option<Request>> {
    let mut line = || -> io::Result<String> {
        let mut text = String::new();
        from.by_ref().take(MOST_LINE).read_line(&mut text)?;
        Ok(text.trim_end().to_owned())
    };
    let first = line()?;
    let mut words = first.split(' ');
    let (Some(method), Some(path)) = (words.next(), words.next()) else { return Ok(None) };
    // What is asked of a page changes nothing here.
    let path = path.split_once('?').map_or(path, |(path, _)| path);
    let mut request =
        Request { method: method.to_owned(), path: path.to_owned(), range: None, host: String::new() };
    for _ in 0..MOST_LINES {
        let text = line()?;
        let Some((name, value)) = text.split_once(':') else { return Ok(Some(request)) };
        match &*name.to_ascii_lowercase() {
            "range" => request.range = Some(value.trim().to_owned()),
            "host" => request.host = value.trim().to_owned(),
            _ => {}
        }
    }
    Ok(None)
}

fn refuse(out: &mut impl Write, status: &str) -> io::Result<()> {
    write!(out, "HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
}

fn send(out: &mut impl Write, is_head: bool, kind: &str, bytes: Vec<u8>) -> io::Result<()> {
    let length = bytes.len();
    write!(
        out,
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n"
    )?;
    if is_head { Ok(()) } else { out.write_all(&bytes) }
}

fn send_file(out: &mut impl Write, is_head: bool, mut file: File, range: Option<&str>) -> io::Result<()> {
    let whole = file.metadata()?.len();
    let (first, length, status) = match range.map(|range| parse_range(range, whole)) {
        None => (0, whole, "200 OK".to_owned()),
        Some(Some((first, last))) => (
            first,
            last - first + 1,
            format!("206 Partial Content\r\nContent-Range: bytes {first}-{last}/{whole}"),
        ),
        Some(None) => {
            return refuse(out, &format!("416 Range Not Satisfiable\r\nContent-Range: bytes */{whole}"));
        }
    };
    write!(
        out,
        "HTTP/1.1 {status}\r\nContent-Type: application/octet-stream\r\nContent-Length: {length}\r\nAccept-Ranges: bytes\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n"
    )?;
    if is_head {
        return Ok(());
    }
    file.seek(SeekFrom::Start(first))?;
    io::copy(&mut file.take(length), out).map(drop)
}

/// The first and last byte of a range `bytes=a-b`, `bytes=a-` or `bytes=-n` of a file; `None` for others, and
/// beyond its end.
fn parse_range(range: &str, whole: u64) -> Option<(u64, u64)> {
    let (first, last) = range.strip_prefix("bytes=")?.split_once('-')?;
    let last_byte = whole.checked_sub(1)?;
    let (first, last) = match (first, last) {
        ("", n) => (whole.saturating_sub(n.parse().ok().filter(|n| *n > 0)?), last_byte),
        (first, "") => (first.parse().ok()?, last_byte),
        (first, last) => (first.parse().ok()?, last.parse::<u64>().ok()?.min(last_byte)),
    };
    (first <= last).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_the_file() {
        for (range, found) in [
            ("bytes=0-9", Some((0, 9))),
            ("bytes=90-200", Some((90, 99))),
            ("bytes=90-", Some((90, 99))),
            ("bytes=-10", Some((90, 99))),
            ("bytes=-1000", Some((0, 99))),
            ("bytes=-0", None),
            ("bytes=100-", None),
            ("bytes=5-2", None),
            ("bytes=a-b", None),
            ("lines=1-2", None),
        ] {
            assert_eq!(parse_range(range, 100), found, "{range}");
        }
        assert_eq!(parse_range("bytes=0-", 0), None);
    }

    /// A client and what the server has of it.
    fn connection() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (client, listener.accept().unwrap().0)
    }

    #[test]
    fn a_client_that_deals_out_bytes_is_left() {
        let (mut client, stream) = connection();
        client.write_all(b"GET").unwrap();
        let mut timed = Timed::new(stream);
        let mut byte = [0];
        assert_eq!(timed.read(&mut byte).unwrap(), 1);
        let until = timed.until;
        timed.write_all(&[0; 1 << 10]).unwrap();
        assert_eq!(timed.until - until, Duration::from_secs_f64(1.0 / 256.0));
        // Though bytes are there to be read, and there is room for more.
        timed.until = Instant::now();
        assert_eq!(timed.read(&mut byte).unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert_eq!(timed.write(&[0]).unwrap_err().kind(), io::ErrorKind::TimedOut);
    }

    #[test]
    fn without_a_thread_the_client_is_told_to_come_again() {
        let open = Arc::new(AtomicUsize::new(0));
        let (mut client, stream) = connection();
        let none = |_: Box<dyn FnOnce() + Send>| Err(io::ErrorKind::WouldBlock.into());
        begin(stream, &open, |_| unreachable!("there is no thread"), none);
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 503 Service Unavailable"), "{answer}");
        assert_eq!(open.load(Ordering::Acquire), 0);
        // While it is answered a connection is counted.
        let (mut client, stream) = connection();
        let counted = Arc::clone(&open);
        let answer = move |mut stream: TcpStream| stream.write_all(&[counted.load(Ordering::Acquire) as u8]);
        begin(stream, &open, answer, |work| {
            work();
            Ok(())
        });
        let mut counted = Vec::new();
        client.read_to_end(&mut counted).unwrap();
        assert_eq!((counted, open.load(Ordering::Acquire)), (vec![1], 0));
    }

    #[test]
    fn requests_are_read_to_the_empty_line() {
        let text = b"GET /data/bundle?hour=12 HTTP/1.1\r\nHost: localhost:80\r\nRange: bytes=1-2\r\n\r\n";
        let request = read_request(&mut &text[..]).unwrap().unwrap();
        assert_eq!(
            (&*request.method, &*request.path, &*request.host),
            ("GET", "/data/bundle", "localhost:80")
        );
        assert_eq!(request.range.as_deref(), Some("bytes=1-2"));
        assert!(read_request(&mut &b"\r\n"[..]).unwrap().is_none());
    }
}
