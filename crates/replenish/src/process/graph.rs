//! The graph as a program sees it: nodes, topics and services, their types, and their endpoints.

use crate::context::Node;
use crate::error::Error;
use crate::middleware::MiddlewareError;
use crate::platform::label;
use crate::qos::Qos;
use std::collections::{BTreeMap, BTreeSet};
use std::string::{String, ToString};
use std::vec::Vec;

/// The nodes, topics and services that are known at one moment, by name: [`Node::graph`].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Graph {
    /// Topics that have a publisher or a subscription. One with several types is there for each.
    pub topics: Vec<GraphTopic>,
    /// Services that have a server or a client.
    pub services: Vec<GraphService>,
    /// Nodes that have a publisher, a subscription or an end of a service. Nodes of the same full
    /// name are one here.
    pub nodes: Vec<GraphNode>,
}

/// A node of the graph.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct GraphNode {
    /// Its name, `talker`.
    pub name: String,
    /// Its namespace, `/` or `/a/b`.
    pub namespace: String,
    /// The full names of the topics that it publishes to.
    pub publishers: Vec<String>,
    /// The full names of the topics that it subscribes to.
    pub subscriptions: Vec<String>,
    /// The full names of the services that it serves.
    pub servers: Vec<String>,
    /// The full names of the services that it is a client of.
    pub clients: Vec<String>,
}

/// A topic of the graph.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct GraphTopic {
    /// The full name, `/chatter`.
    pub name: String,
    /// `std_msgs/msg/Int32`.
    pub type_name: String,
    /// The quality that each publisher offers. Peers need not announce history and depth.
    pub publishers: Vec<Qos>,
    /// The quality that each subscription asks for.
    pub subscriptions: Vec<Qos>,
}

/// A service of the graph.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct GraphService {
    /// The full name, `/add`.
    pub name: String,
    /// `example_interfaces/srv/AddTwoInts`.
    pub type_name: String,
    /// Number of servers.
    pub servers: usize,
    /// Number of clients.
    pub clients: usize,
}

impl Graph {
    /// The topic of this name.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&GraphTopic> {
        self.topics.iter().find(|topic| topic.name == name)
    }

    /// The node of this full name, `/a/b/talker`.
    #[must_use]
    pub fn node(&self, full_name: &str) -> Option<&GraphNode> {
        self.nodes.iter().find(|node| node.full_name() == full_name)
    }

    /// The service of this name.
    #[must_use]
    pub fn service(&self, name: &str) -> Option<&GraphService> {
        self.services.iter().find(|service| service.name == name)
    }
}

impl GraphNode {
    /// Its full name, `/a/b/talker`.
    #[must_use]
    pub fn full_name(&self) -> String {
        let space = self.namespace.trim_end_matches('/');
        std::format!("{space}/{}", self.name)
    }
}

/// The names of what a node has: topics written and read, services asked and served.
type Ends = [BTreeSet<String>; 4];

fn graph_node((full, ends): (String, Ends)) -> GraphNode {
    let (space, name) = full.rsplit_once('/').unwrap_or(("", &full));
    let [publishers, subscriptions, clients, servers] = ends.map(|of| of.into_iter().collect());
    GraphNode {
        name: name.into(),
        namespace: if space.is_empty() { "/" } else { space }.into(),
        publishers,
        subscriptions,
        servers,
        clients,
    }
}

impl Node {
    /// The nodes, topics and services of the domain as far as they are known at this moment, those
    /// of other programs included. A participant that has just begun knows few: look again. For
    /// set-up: it allocates, and holds up publishers of this context while it reads.
    ///
    /// ```
    /// use replenish::{Context, Qos, msg::std_msgs::Int32};
    /// let node = Context::in_process().node("n")?;
    /// let _out = node.publisher::<Int32>("number", Qos::reliable())?;
    /// let graph = node.graph()?;
    /// assert_eq!(graph.topic("/number").map(|t| t.publishers.len()), Some(1));
    /// assert_eq!(graph.node("/n").map(|n| n.publishers.join(" ")).as_deref(), Some("/number"));
    /// # Ok::<(), replenish::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know: DDS-XRCE.
    pub fn graph(&self) -> Result<Graph, Error> {
        let mut topics: BTreeMap<(String, String), GraphTopic> = BTreeMap::new();
        let mut services: BTreeMap<(String, String), GraphService> = BTreeMap::new();
        let mut nodes: BTreeMap<String, Ends> = BTreeMap::new();
        let middleware = self.context().middleware();
        middleware.nodes(&mut |node| {
            nodes.entry(node.into()).or_default();
        });
        let known = middleware.graph(&mut |end| {
            if let Some(node) = end.node {
                let ends = nodes.entry(node.into()).or_default();
                let kind = usize::from(end.service) * 2 + usize::from(!end.writes);
                if let Some(names) = ends.get_mut(kind) {
                    names.insert(end.name.into());
                }
            }
            let (name, type_name) = (end.name.to_string(), end.type_name.to_string());
            let key = (name.clone(), type_name.clone());
            if end.service {
                let service = services.entry(key).or_insert_with(|| GraphService {
                    name,
                    type_name,
                    ..GraphService::default()
                });
                service.clients += usize::from(end.writes);
                service.servers += usize::from(!end.writes);
                return;
            }
            let topic = topics.entry(key).or_insert_with(|| GraphTopic {
                name,
                type_name,
                ..GraphTopic::default()
            });
            if end.writes {
                topic.publishers.push(end.qos);
            } else {
                topic.subscriptions.push(end.qos);
            }
        });
        if !known {
            let unknown = label("to know the graph, which no agent tells");
            let unknown = MiddlewareError::Unsupported(unknown);
            return Err(Error::endpoint("node", self.name(), unknown));
        }
        Ok(Graph {
            topics: topics.into_values().collect(),
            services: services.into_values().collect(),
            nodes: nodes.into_iter().map(graph_node).collect(),
        })
    }
}
