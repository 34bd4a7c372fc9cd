//! Drawing threads that are used again: windows without a screen come and go, and a software adapter compiles a minute for each scene.
//!
//! When its window goes, a thread forgets what it drew and what it measured. The next window of the same scene finds a device and a loaded scene,
//! with the shaders, terrain nodes and pages that others needed: no picture depends on those. What a frame had to make anew does, as the nodes that
//! it loaded: whoever counts that starts a thread of its own.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use kernels::scene::Scene;

use super::{Boxes, Engine, Wake, lock};
use crate::model::picture::News;

/// Threads that wait, at most: each holds a device and the textures of a scene.
const MOST: usize = 4;

/// Threads that nobody uses. At the end of the program they are waiting for a wish, so that they end with it.
static IDLE: Mutex<Vec<Engine>> = Mutex::new(Vec::new());

impl Engine {
    /// As [`Engine::start`] with the shaders of the program, but by a thread that drew this scene for another window, if one waits; and dropped, it
    /// waits for the next.
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

    /// Leaves the thread to the next window, if it is one that is used again. Says whether it did; if not, it is to be ended.
    pub(super) fn give_back(&mut self) -> bool {
        // Whatever a test fails at is no other's business.
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
    /// Has the thread forget what it drew, once it is done with the picture in hand; then there are no news but who draws. Says whether the thread is
    /// still there.
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

    /// To be called by the thread when it has forgotten what it drew.
    pub(super) fn rested(&self) {
        lock(&self.mail).rest = false;
        self.rested.notify_all();
    }

    /// To be called by the thread as the last thing it does.
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

    /// A thread that keeps to the rules without drawing: whatever it is asked for, it is slow, and fails.
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
                // Whoever has rested waits.
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

        // Given back in the middle of its work, it is waited for: nothing is told afterwards.
        let engine = pretended(&first, wake(0));
        engine.warm();
        let boxes = engine.boxes.clone();
        while engine.news().failure.is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(engine);
        assert_eq!(idle(), 1);
        let before = woken[0].load(Ordering::Relaxed);
        // Another scene's window has no use for it, this one's has.
        assert!(!lock(&IDLE).iter().any(|engine| engine.scene.as_deref() == Some(&other)));
        let engine = Engine::shared(&first, wake(1));
        assert!(Arc::ptr_eq(&engine.boxes, &boxes) && idle() == 0);
        std::thread::sleep(Duration::from_millis(100));
        let news = engine.news();
        assert_eq!((news.failure, news.warm, news.shown.is_none()), (None, [0, 0], true));
        assert_eq!(news.adapter.map(|adapter| adapter.name).as_deref(), Some("pretended"));
        assert!(!lock(&boxes.mail).warming);
        assert_eq!((woken[0].load(Ordering::Relaxed), woken[1].load(Ordering::Relaxed)), (before, 0));
        // What it tells from now on wakes the new window alone.
        boxes.tell(|_| {});
        assert_eq!((woken[0].load(Ordering::Relaxed), woken[1].load(Ordering::Relaxed)), (before, 1));
        drop(engine);
        assert_eq!(idle(), 1);

        // One that has ended is not kept.
        let engine = pretended(&other, |_| {});
        lock(&engine.boxes.mail).stop = true;
        engine.boxes.arrived.notify_one();
        drop(engine);
        assert_eq!(idle(), 1);

        // Nor is one too many: the oldest goes.
        let more: Vec<Engine> = (0..MOST).map(|_| pretended(&other, |_| {})).collect();
        drop(more);
        assert_eq!(idle(), MOST);
        assert!(lock(&IDLE).iter().all(|engine| engine.scene.as_deref() == Some(&other)));
        assert!(lock(&boxes.mail).ended, "the oldest was ended");
        lock(&IDLE).drain(..).for_each(|mut engine| engine.scene = None);
    }
}
