//! Addresses and their answers. Every answer is computed from the results on the disk or from the
//! prepared switches; nothing here serves files.

use crate::events;
use crate::guard::guard;
use crate::jobs::Request;
use crate::patience::SIGN_OF_LIFE;
use crate::state::Studio;
use crate::view;
use aloft_analysis::own_laws;
use aloft_analysis::switches::LeftOut;
use aloft_effects::FormulaEffect;
use aloft_page::{Live, switches as panel};
use aloft_workspace::error::{PipelineError, StageFailure};
use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::sse::{KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Instant;

/// Largest request, bytes: a list of effects and settings.
const LARGEST: usize = 64 * 1024;

/// The addresses of the server.
pub(crate) fn router(studio: Arc<Studio>) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/api/state", get(state))
        .route("/api/subjects", get(subjects))
        .route("/api/model", post(model))
        .route("/api/series", post(series))
        .route("/api/job", post(job))
        .route("/api/law", post(law))
        .route("/api/law/forget", post(forget))
        .route("/api/notes", post(notes))
        .route("/api/events", get(listen))
        .layer(DefaultBodyLimit::max(LARGEST))
        .layer(from_fn_with_state(Arc::clone(&studio), guard))
        .with_state(studio)
}

/// An error as JSON, with what to do about it.
struct Problem(StatusCode, StageFailure);

impl From<PipelineError> for Problem {
    fn from(error: PipelineError) -> Self {
        Self(StatusCode::CONFLICT, error.into())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let body = json!({"problem": self.1.problem, "hint": self.1.hint});
        (self.0, [(header::CONTENT_TYPE, "application/json")], body.to_string()).into_response()
    }
}

fn answer(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

fn asked<T: DeserializeOwned>(body: &Bytes) -> Result<T, Problem> {
    serde_json::from_slice(body)
        .map_err(|e| Problem(StatusCode::BAD_REQUEST, StageFailure::new(format!("the request is not understood: {e}"))))
}

/// Computes on a thread of its own, so that other answers need not wait.
async fn computed<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, PipelineError> + Send + 'static,
) -> Result<T, Problem> {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => Ok(done?),
        // none: the answer says that the computation broke off
        Err(_) => {
            let broken = StageFailure::with_hint("a computation broke off", "see the terminal of `aloft studio`");
            Err(Problem(StatusCode::INTERNAL_SERVER_ERROR, broken))
        }
    }
}

/// The report as a live page.
async fn page(State(studio): State<Arc<Studio>>) -> Result<Response, Problem> {
    let html = computed(move || {
        studio.queue.add(Request::Prepare);
        let live = Live {
            panel: &panel::live_panel(
                include_str!("browser/actions.html"),
                include_str!("browser/ask.html"),
                include_str!("browser/more.html"),
            ),
            style: &[panel::STYLE, include_str!("browser/studio.css")].concat(),
            script: &[
                panel::SCRIPT,
                include_str!("browser/live.js"),
                include_str!("browser/law.js"),
                include_str!("browser/notes.js"),
                include_str!("browser/stretches.js"),
                include_str!("browser/revisions.js"),
                include_str!("browser/subjects.js"),
                include_str!("browser/forces.js"),
            ]
            .concat(),
            served: true,
        };
        aloft_report::live(&(studio.open)()?, &live)
    })
    .await?;
    Ok(Html(html).into_response())
}

/// Everything that the panel shows before a switch is flipped.
async fn state(State(studio): State<Arc<Studio>>) -> Result<Response, Problem> {
    Ok(answer(&computed(move || view::state(&studio)).await?))
}

/// All subjects of the study as the table of its report, from their results on the disk.
async fn subjects(State(studio): State<Arc<Studio>>) -> Result<Response, Problem> {
    let found = computed(move || {
        let Some(open) = &studio.open_set else { return Ok(json!({"html": null, "without": []})) };
        let set = open()?;
        let (html, mut without) = aloft_report::side_by_side(&set.members)?;
        without.extend(set.broken.iter().map(|b| format!("{}: {}", b.id, b.failure.problem)));
        Ok(json!({"html": html, "without": without}))
    });
    Ok(answer(&found.await?))
}

/// A choice of effects and of recordings.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SwitchRequest {
    effects: Vec<String>,
    #[serde(default)]
    left_out: LeftOut,
}

/// The model with other effects, at once.
async fn model(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let choice: SwitchRequest = asked(&body)?;
    let found = computed(move || {
        let started = Instant::now();
        let switches = studio.switches()?;
        let model = studio.quick.install(|| switches.model(&choice.effects, &choice.left_out))?;
        Ok(json!({"model": model, "milliseconds": started.elapsed().as_secs_f64() * 1e3}))
    });
    Ok(answer(&found.await?))
}

/// A recording and a choice of effects.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Curves {
    trial: String,
    effects: Vec<String>,
}

/// Forces of a recording that the model with other effects predicts.
async fn series(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let asked: Curves = asked(&body)?;
    let found = computed(move || {
        let series = studio.switches()?.series(&asked.trial, &asked.effects)?;
        Ok(view::curves(&series))
    });
    Ok(answer(&found.await?))
}

/// Takes a law that was written in the page as a switch; what is wrong in it is the answer
/// otherwise.
async fn law(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let law: FormulaEffect = asked(&body)?;
    let found = computed(move || {
        let session = (studio.open)()?;
        let own = match own_laws::checked(&session, &law) {
            Ok(own) => own,
            Err(wrong) => return Ok(json!({"wrong": wrong})),
        };
        studio.change_drafts(|all| {
            all.retain(|d| d.spec.id != own.spec.id);
            all.push(own);
        });
        studio.queue.add(Request::Prepare);
        Ok(json!({"key": law.id}))
    });
    Ok(answer(&found.await?))
}

/// Name of a law.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Named {
    key: String,
}

/// Forgets a law that was not kept.
async fn forget(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let named: Named = asked(&body)?;
    studio.change_drafts(|all| all.retain(|d| d.spec.id != named.key));
    studio.queue.add(Request::Prepare);
    Ok(answer(&json!({"forgotten": named.key})))
}

/// Notes, and those that they replace.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Notes {
    before: String,
    after: String,
}

/// Keeps the notes.
async fn notes(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let notes: Notes = asked(&body)?;
    computed(move || aloft_analysis::notes::write(&(studio.open)()?, &notes.before, &notes.after)).await?;
    Ok(answer(&json!({"kept": true})))
}

/// Takes work into the queue; its progress and its result come as events.
async fn job(State(studio): State<Arc<Studio>>, body: Bytes) -> Result<Response, Problem> {
    let job: Request = asked(&body)?;
    let name = job.name();
    studio.queue.add(job);
    Ok(answer(&json!({"accepted": name})))
}

/// What the server tells by itself.
async fn listen(State(studio): State<Arc<Studio>>) -> Response {
    Sse::new(events::stream(studio.events.subscribe()))
        .keep_alive(KeepAlive::new().interval(SIGN_OF_LIFE))
        .into_response()
}
