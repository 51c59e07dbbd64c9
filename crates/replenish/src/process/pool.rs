//! Messages that a publisher lends, its subscriptions in this process read in place, and nobody
//! copies.

use crate::error::Error;
use crate::handoff::{self, Shared};
use crate::middleware::PublishError;
use crate::platform::text;
use crate::publisher::Publisher;
use core::fmt;
use core::ops::{Deref, DerefMut};
use replenish_msg::Message;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::vec::Vec;

/// The most messages of one pool.
const MOST: usize = 4096;

/// Messages whose publisher has gone while somebody read them: freed by the next one that makes a
/// pool or drops one, and not by a reader.
static RETIRED: Mutex<Vec<Shared>> = Mutex::new(Vec::new());

/// Locked at set-up and at the end only, so its lock needs no priority inheritance.
fn retired() -> MutexGuard<'static, Vec<Shared>> {
    RETIRED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<M: Message + Clone + Sync> Publisher<M> {
    /// A pool of so many messages, each as `make` makes it: 1 to 4096. Messages are
    /// [lent](Pool::loan), filled in place and [published](Loan::publish). A subscription in this
    /// process to the same Rust type gets `&M` of that very memory, on its worker, without
    /// serialisation; a message is free again when the last callback has ended.
    ///
    /// All memory is taken here: of an unbounded field, `make` reserves what messages will need,
    /// and the field keeps it. One message is being filled; each subscription has as many waiting
    /// as its depth says, and one in its callback. With fewer a slow subscription can make
    /// [`loan`](Pool::loan) fail.
    ///
    /// ```
    /// use replenish::{Context, Executor, Qos, Topic};
    /// use replenish::interfaces::sensor_msgs::msg::Image;
    /// let ctx = Context::in_process();
    /// let node = ctx.node("camera")?;
    /// let topic = Topic::named("image").max_size(1_000_100);
    /// let newest = Qos::sensor_data().keep_last(1);
    /// let pixels = || Image { data: vec![0; 1_000_000], ..Image::default() };
    /// let images = node.publisher::<Image>(topic, newest)?.pool(3, pixels)?;
    ///
    /// let mut exec = Executor::new(&ctx);
    /// exec.worker("viewer").subscribe(&node, topic, newest, |image: &Image, cx| {
    ///     assert_eq!(image.data[999_999], 7); // the bytes that were written below
    ///     cx.stop();
    /// })?;
    /// let mut image = images.loan()?;
    /// image.data.fill(7);
    /// image.publish()?;
    /// exec.spin()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Parameter`] for a number out of range.
    pub fn pool(&self, messages: usize, mut make: impl FnMut() -> M) -> Result<Pool<M>, Error> {
        if !(1..=MOST).contains(&messages) {
            let owner = text!("topic {}", self.topic());
            return Err(Error::parameter(owner, "pool", &messages, "1..=4096"));
        }
        free_retired();
        let messages = (0..messages).map(|_| Arc::new(make()));
        Ok(Pool {
            inner: Arc::new(Inner {
                messages: handoff::Pool::new(messages),
                publisher: self.clone(),
            }),
        })
    }
}

/// The messages of a publisher that can be lent. Clones are the same pool; any thread may use it.
pub struct Pool<M: Message + Sync> {
    inner: Arc<Inner<M>>,
}

struct Inner<M: Message + Sync> {
    messages: handoff::Pool<Arc<M>>,
    publisher: Publisher<M>,
}

impl<M: Message + Sync> Drop for Inner<M> {
    fn drop(&mut self) {
        let held = self.messages.held();
        let held = held.iter().map(Shared::of);
        retired().extend(held);
        free_retired();
    }
}

impl<M: Message + Clone + Sync> Pool<M> {
    /// A message to fill and to publish. It has the values with which it was published last, and
    /// its fields the memory they had. Does not allocate and waits for nobody.
    ///
    /// # Errors
    /// [`PublishError::AllLent`] while each message is lent, waits for a subscription, or is read.
    pub fn loan(&self) -> Result<Loan<M>, PublishError> {
        let pool = &self.inner.messages;
        let Some((place, message)) = pool.take() else {
            return Err(PublishError::AllLent { size: pool.size() });
        };
        Ok(Loan {
            message,
            place,
            pool: Arc::clone(&self.inner),
        })
    }
}

impl<M: Message + Sync> Pool<M> {
    /// Number of messages that could be lent at this moment.
    #[must_use]
    pub fn free(&self) -> usize {
        self.inner.messages.free()
    }

    /// The publisher that it belongs to.
    #[must_use]
    pub fn publisher(&self) -> &Publisher<M> {
        &self.inner.publisher
    }
}

impl<M: Message + Sync> Clone for Pool<M> {
    fn clone(&self) -> Self {
        Self {
            inner: Arc::clone(&self.inner),
        }
    }
}

impl<M: Message + Sync> fmt::Debug for Pool<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool")
            .field("publisher", &self.inner.publisher)
            .field("messages", &self.inner.messages.size())
            .field("free", &self.free())
            .finish()
    }
}

/// A message of a [`Pool`] in the hands of its publisher. Dropped, it goes back unpublished.
pub struct Loan<M: Message + Sync> {
    message: Arc<M>,
    place: usize,
    pool: Arc<Inner<M>>,
}

impl<M: Message + Clone + Sync> Loan<M> {
    /// Hands the message to every subscription. Does not allocate and waits for nobody.
    ///
    /// A subscription of another Rust type, of views or of bytes, one that keeps all, and one in
    /// another process get it encoded, as from [`Publisher::publish`]; it is encoded once, and not
    /// at all if there are none. A publisher that is transient local encodes each message.
    ///
    /// # Errors
    /// As [`Publisher::publish`]; the message goes back to its pool.
    pub fn publish(self) -> Result<(), PublishError> {
        let shared = Shared::of(&self.message);
        self.pool.publisher.publish_shared(&shared, &self.message)
    }
}

impl<M: Message + Sync> Deref for Loan<M> {
    type Target = M;

    fn deref(&self) -> &M {
        &self.message
    }
}

impl<M: Message + Clone + Sync> DerefMut for Loan<M> {
    fn deref_mut(&mut self) -> &mut M {
        // Only this loan holds it, so it is never cloned.
        Arc::make_mut(&mut self.message)
    }
}

impl<M: Message + Sync> Drop for Loan<M> {
    fn drop(&mut self) {
        let message = Arc::clone(&self.message);
        self.pool.messages.give_back(self.place, message);
    }
}

impl<M: Message + Sync + fmt::Debug> fmt::Debug for Loan<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Loan").field(&*self.message).finish()
    }
}

/// Frees the messages that nobody reads any more.
fn free_retired() {
    let free: Vec<Shared> = {
        let mut retired = retired();
        retired.extract_if(.., Shared::is_alone).collect()
    };
    drop(free); // without the lock
}
