//! A pool of drawing threads for windows without a screen, as in tests. Starting a thread for each window would be slow: a software adapter compiles
//! shaders for about a minute per scene.
//!
//! When its window closes, a thread forgets what it drew and measured, but keeps its device and the loaded scene, with shaders, terrain nodes and
//! pages. The next window of the same scene uses them again. Pictures do not depend on what is already loaded. Some counts of a frame depend on it,
//! such as the number of nodes that were loaded for the frame. A test that checks such a count needs a thread of its own ([`Engine::start`]), unless
//! the count is the same in all cases.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use kernels::scene::Scene;

use super::{Boxes, Engine, Wake, lock};
use crate::model::picture::News;

/// Maximum number of idle threads. There is a limit because each thread keeps a device and the textures of a scene in memory.
const MOST: usize = 4;

/// Idle threads. An idle thread only waits for a request, so the program may end without stopping it.
static IDLE: Mutex<Vec<Engine>> = Mutex::new(Vec::new());

impl Engine {
    /// Like [`Engine::start`] with the shaders of the program, but uses an idle thread that has drawn this scene for another window, if there is one.
    /// When the engine is dropped, its thread becomes idle again.
    pub fn shared(scene: &Scene, wake: impl Fn(Duration) + Send + Sync + 'static) -> Engine {
        let idle = {
            let mut idle = lock(&IDLE);
            idle.iter().rposition(|engine| engine.scene.as_deref() == Some(scene)).map(|at| idle.remove(at))
        };
        if let Some(engine) = idle {
            *lock(&engine.boxes.wake) = Arc::new(wake);
            return engine;
        }
        let mut engine = Engine::start(None, wake);
        engine.scene = Some(Box::new(scene.clone()));
        engine
    }

    /// Puts the thread into the pool, if it was started by [`Engine::shared`]. Returns whether the thread is now in the pool; if not, the caller must
    /// end it.
    pub(super) fn give_back(&mut self) -> bool {
        // After a failed test, the thread may be in a bad state, so do not use it again.
        let Some(scene) = self.scene.take().filter(|_| !std::thread::panicking()) else { return false };
        if !self.boxes.rest() {
            return false;
        }
        let rested = Engine { boxes: self.boxes.clone(), thread: self.thread.take(), scene: Some(scene) };
        let surplus = {
            let mut idle = lock(&IDLE);
            idle.push(rested);
            (idle.len() > MOST).then(|| idle.remove(0))
        };
        if let Some(mut surplus) = surplus {
            surplus.scene = None;
        }
        true
    }
}

impl Boxes {
    /// Makes the thread forget what it drew, after it has finished the current picture, and clears what it reported, except for the adapter. Returns
    /// whether the thread is still running.
    fn rest(&self) -> bool {
        let alive = {
            let mut mail = lock(&self.mail);
            (mail.wish, mail.warming, mail.rest) = (None, false, true);
            self.arrived.notify_one();
            while mail.rest && !mail.ended {
                mail = self.rested.wait(mail).unwrap_or_else(PoisonError::into_inner);
            }
            !mail.ended
        };
        let silent: Wake = Arc::new(|_| {});
        *lock(&self.wake) = silent;
        let mut news = lock(&self.news);
        let adapter = news.adapter.take();
        *news = News { adapter, ..News::default() };
        alive
    }

    /// The thread calls this after it has forgotten what it drew.
    pub(super) fn rested(&self) {
        lock(&self.mail).rest = false;
        self.rested.notify_all();
    }

    /// The thread calls this as its last action.
    pub(super) fn ended(&self) {
        lock(&self.mail).ended = true;
        self.rested.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use kernels::scene;

    use super::super::Next;
    use super::*;
    use crate::model::picture::Adapter;

    /// An engine whose thread handles the mailboxes like a drawing thread but does not draw. The thread is slow, and every request fails.
    fn pretended(scene: &Scene, wake: impl Fn(Duration) + Send + Sync + 'static) -> Engine {
        let boxes = Arc::new(Boxes::new(Arc::new(wake)));
        let own = boxes.clone();
        let thread = std::thread::spawn(move || {
            own.tell(|news| news.adapter = Some(Adapter { name: "pretended".to_owned(), software: true, without_anisotropy: None }));
            loop {
                std::thread::sleep(Duration::from_millis(30));
                own.tell(|news| (news.failure, news.warm) = (Some("it failed".to_owned()), [1, 2]));
                match own.next(true, None) {
                    Next::Rest => own.rested(),
                    Next::Stop => break,
                    Next::Wish(_) | Next::Idle => continue,
                }
                // After `rested`, the thread does nothing until the next request.
                if matches!(own.next(false, None), Next::Stop) {
                    break;
                }
            }
            own.ended();
        });
        Engine { boxes, thread: Some(thread), scene: Some(Box::new(scene.clone())) }
    }

    fn idle() -> usize {
        lock(&IDLE).len()
    }

    #[test]
    fn a_thread_is_used_again_for_its_scene_and_tells_nothing_of_before() {
        let first = scene::load(scene::DEFAULT).expect("built in");
        let other = Scene { name: "other".to_owned(), ..first.clone() };
        let woken: [Arc<AtomicUsize>; 2] = Default::default();
        let wake = |index: usize| {
            let count = woken[index].clone();
            move |_| {
                count.fetch_add(1, Ordering::Relaxed);
            }
        };

        // If an engine is dropped while its thread works, `drop` waits until the thread has called `rested`. After that, the thread reports nothing.
        let engine = pretended(&first, wake(0));
        engine.warm();
        let boxes = engine.boxes.clone();
        while engine.news().failure.is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(engine);
        assert_eq!(idle(), 1);
        let before = woken[0].load(Ordering::Relaxed);
        // A window of another scene cannot use the thread. A window of the same scene can.
        assert!(!lock(&IDLE).iter().any(|engine| engine.scene.as_deref() == Some(&other)));
        let engine = Engine::shared(&first, wake(1));
        assert!(Arc::ptr_eq(&engine.boxes, &boxes) && idle() == 0);
        std::thread::sleep(Duration::from_millis(100));
        let news = engine.news();
        assert_eq!((news.failure, news.warm, news.shown.is_none()), (None, [0, 0], true));
        assert_eq!(news.adapter.map(|adapter| adapter.name).as_deref(), Some("pretended"));
        assert!(!lock(&boxes.mail).warming);
        assert_eq!((woken[0].load(Ordering::Relaxed), woken[1].load(Ordering::Relaxed)), (before, 0));
        // From now on, reports of the thread wake only the new window.
        boxes.tell(|_| {});
        assert_eq!((woken[0].load(Ordering::Relaxed), woken[1].load(Ordering::Relaxed)), (before, 1));
        drop(engine);
        assert_eq!(idle(), 1);

        // A thread that has ended is not put into the pool.
        let engine = pretended(&other, |_| {});
        lock(&engine.boxes.mail).stop = true;
        engine.boxes.arrived.notify_one();
        drop(engine);
        assert_eq!(idle(), 1);

        // If there are too many idle threads, the oldest one is ended.
        let more: Vec<Engine> = (0..MOST).map(|_| pretended(&other, |_| {})).collect();
        drop(more);
        assert_eq!(idle(), MOST);
        assert!(lock(&IDLE).iter().all(|engine| engine.scene.as_deref() == Some(&other)));
        assert!(lock(&boxes.mail).ended, "the oldest was ended");
        lock(&IDLE).drain(..).for_each(|mut engine| engine.scene = None);
    }
}
