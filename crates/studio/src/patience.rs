//! Connections that are begun and not used: each holds memory and a file of the process, and some
//! systems allow only 256 of them. A connection is closed when neither a whole request came nor an
//! answer went for a while.

use axum::serve::Listener;
use std::future::Future;
use std::io::{Error, ErrorKind, Result};
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, Sleep, sleep};

/// How long a connection may take, from its beginning or from the last byte of an answer, to ask,
/// and then to be answered.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Until the head of a request has come: browsers send it at once.
    pub request: Duration,
    /// Until the first byte of its answer: the page of a large study takes many seconds.
    pub answer: Duration,
}

/// Of the server. A page that listens is written to every [`SIGN_OF_LIFE`].
pub(crate) const PATIENCE: Patience = Patience { request: Duration::from_secs(20), answer: Duration::from_secs(300) };

/// How often a page that listens is written to: well within the patience for a request.
pub(crate) const SIGN_OF_LIFE: Duration = Duration::from_secs(5);

/// What ends the head of a request.
const END: &[u8; 4] = b"\r\n\r\n";

/// A listener whose connections are closed when they are not used.
pub(crate) struct Patient {
    pub listener: TcpListener,
    pub patience: Patience,
}

impl Listener for Patient {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let (stream, address) = Listener::accept(&mut self.listener).await;
        let until = Box::pin(sleep(self.patience.request));
        (Connection { stream, patience: self.patience, until, seen: 0 }, address)
    }

    fn local_addr(&self) -> Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection with the time at which it is closed.
pub(crate) struct Connection {
    stream: TcpStream,
    patience: Patience,
    until: Pin<Box<Sleep>>,
    /// How much of [`END`] the last bytes were.
    seen: usize,
}

impl Connection {
    /// Waits longer once the head of a request is complete.
    fn read(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.seen = if *byte == END[self.seen] { self.seen + 1 } else { usize::from(*byte == END[0]) };
            if self.seen == END.len() {
                self.seen = 0;
                self.until.as_mut().reset(Instant::now() + self.patience.answer);
            }
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<Result<()>> {
        // asked first, so that one byte now and then does not keep it open
        if self.until.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the connection was not used")));
        }
        let before = buffer.filled().len();
        let done = Pin::new(&mut self.stream).poll_read(cx, buffer);
        self.read(&buffer.filled()[before..]);
        done
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize>> {
        let done = Pin::new(&mut self.stream).poll_write(cx, bytes);
        if matches!(done, Poll::Ready(Ok(_))) {
            let until = Instant::now() + self.patience.request;
            self.until.as_mut().reset(until);
        }
        done
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use axum::Router;
    use axum::routing::get;
    use std::io::{Read, Write};

    #[test]
    fn regress_half_open_connections_are_closed_and_slow_answers_are_not() {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let request = Duration::from_millis(400);
        let patience = Patience { request, answer: 20 * request };
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = listener.local_addr().unwrap();
        let router = Router::new().route(
            "/",
            get(move || async move {
                sleep(2 * request).await;
                "answer"
            }),
        );
        runtime.spawn(async move { axum::serve(Patient { listener, patience }, router).await });
        let open = || std::net::TcpStream::connect(address).unwrap();
        // nothing, half a request, and one byte now and then
        let (mut silent, mut half, mut slow) = (open(), open(), open());
        half.write_all(b"GET / HTTP/1.1\r\nHost: x\r\n").unwrap();
        let started = std::time::Instant::now();
        for byte in b"GET / HTTP/1.1\r\nX-Long: aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa" {
            if slow.write_all(&[*byte]).is_err() || started.elapsed() > 3 * request {
                break;
            }
            std::thread::sleep(request / 20);
        }
        for connection in [&mut silent, &mut half, &mut slow] {
            connection.set_read_timeout(Some(4 * request)).unwrap();
            let mut told = Vec::new();
            // closed: the end of what comes, or a connection that was reset
            let ended = connection.read_to_end(&mut told);
            assert!(ended.is_ok() || ended.is_err_and(|e| e.kind() == ErrorKind::ConnectionReset));
        }
        let mut used = open();
        used.write_all(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").unwrap();
        let mut told = String::new();
        used.read_to_string(&mut told).unwrap();
        assert!(told.ends_with("answer"), "{told}");
    }
}
