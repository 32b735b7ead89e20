//! `studio`: the report of a study as a live page, served to a browser on the same machine.
//!
//! The page is that of `aloft report` with a panel beside it. Every effect that the last discovery
//! ranked is a switch; flipping one shows what the model's error, its parameters and its forces
//! become. What is shown is a preview: nothing in the workspace changes until *Keep* is pressed,
//! which does what `aloft effect add` and `remove` do.
//!
//! | module | what it does |
//! |---|---|
//! | `state` | what the server knows: how to open the study, its switches, the queue of work |
//! | `guard` | who may talk to the server |
//! | `patience` | closes connections that are not used |
//! | `endpoints` | addresses and their answers |
//! | `jobs` | work that takes longer than an answer, one piece after the other |
//! | `events` | what the server tells the pages by itself |
//! | `browser/` | panel, style and script of the page |
//!
//! There is no science here: numbers come from `analysis`.

mod endpoints;
mod events;
mod guard;
mod jobs;
mod patience;
mod state;
mod view;

pub use state::{Opener, SetOpener};

use aloft_workspace::error::PipelineError;
use patience::{PATIENCE, Patient};
use state::Studio;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use tokio::net::TcpListener;

/// A server that listens, and has not answered yet.
pub struct Server {
    listener: std::net::TcpListener,
    studio: Arc<Studio>,
}

impl Server {
    /// Listens on a port of the loopback interface (0: any free one) and begins to prepare the
    /// switches. `open_set` opens all subjects of a study that has several.
    ///
    /// # Errors
    /// The study cannot be opened; the port is in use.
    pub fn bind(open: Opener, open_set: Option<SetOpener>, port: u16) -> Result<Self, PipelineError> {
        open()?;
        let taken = |e: std::io::Error| {
            PipelineError::request_hint(
                format!("cannot listen on port {port} of this machine: {e}"),
                "choose another with --port, or leave --port away",
            )
        };
        let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        let port = listener.local_addr().map_err(taken)?.port();
        let token = guard::new_token()
            .map_err(|e| PipelineError::request(format!("the system gives no random numbers for a token: {e}")))?;
        let studio = Studio::new(open, open_set, token, port)
            .map_err(|e| PipelineError::request(format!("the system gives no threads: {e}")))?;
        jobs::start(&studio);
        Ok(Self { listener, studio })
    }

    /// The address to open in a browser, with the token of this start.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.studio.port, self.studio.token)
    }

    /// Where it listens.
    pub fn socket(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.studio.port))
    }

    /// Answers until the process ends.
    ///
    /// # Errors
    /// The operating system refuses threads or the socket.
    pub fn run(self) -> Result<(), PipelineError> {
        let broken = |e: std::io::Error| PipelineError::request(format!("the server stopped: {e}"));
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().map_err(broken)?;
        runtime.block_on(async {
            let listener = TcpListener::from_std(self.listener).map_err(broken)?;
            let listener = Patient { listener, patience: PATIENCE };
            axum::serve(listener, endpoints::router(self.studio)).await.map_err(broken)
        })
    }
}
