extends RefCounted
## Searches for the address of a host name by the engine's resolver. The search ends when this object is freed.

var _id := IP.RESOLVER_INVALID_ID


func _init(host: String) -> void:
	_id = IP.resolve_hostname_queue_item(host)


func _notification(what: int) -> void:
	if what == NOTIFICATION_PREDELETE and _id != IP.RESOLVER_INVALID_ID:
		IP.erase_resolve_item(_id)


## Return the address, of IPv4 if there is one; empty while it is not known. It stays unknown if too many hosts are
## searched for at the same time.
func address() -> String:
	if _id == IP.RESOLVER_INVALID_ID or IP.get_resolve_item_status(_id) != IP.RESOLVER_STATUS_DONE:
		return ""
	var addresses := IP.get_resolve_item_addresses(_id)
	var four := addresses.filter(func(each: String) -> bool: return "." in each)
	return (four if not four.is_empty() else addresses)[0]


## Return whether the search has ended without an address.
func has_failed() -> bool:
	return _id != IP.RESOLVER_INVALID_ID and IP.get_resolve_item_status(_id) == IP.RESOLVER_STATUS_ERROR
